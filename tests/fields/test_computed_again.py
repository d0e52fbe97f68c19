"""The forces of the independent checks: against the core's in orbits of every kind, and where they do not know a field."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj._core.fields import Bodies
from ffsm_mj.fields.config import OrbitConfig
from ffsm_mj.fields.orbit import Orbit
from ffsm_mj.verification.independent.fields import KnownFields
from tests.contact_models.grasp.scenes import grasping
from tests.fields.fields import DragConstant
from tests.verification.independent.scenes import independent

ANGLES = {"inclination_deg": 98.0, "raan_deg": 33.0}
ELLIPTIC = {"kind": "elliptic", "true_anomaly_deg": -130.0, "argument_of_perigee_deg": 20.0, **ANGLES}
ORBITS = {
    "altitude": ({"altitude_km": 400.0}, "hill"),
    "radius": ({"radius_km": 42164.17, "argument_of_latitude_deg": 70.0, **ANGLES}, "eci"),
    "period": ({"body": "moon", "period_min": 120.0, "argument_of_latitude_deg": 70.0, **ANGLES, "j2": True}, "hill"),
    "ellipse": (ELLIPTIC | {"semi_major_axis_km": 26000.0, "eccentricity": 0.7}, "eci"),
    "altitudes": (ELLIPTIC | {"perigee_altitude_km": 300.0, "apogee_altitude_km": 3000.0, "j2": True}, "lvlh"),
    "state": ({"kind": "state", "body": "mars", "position_km": [4000, 1000, -500], "velocity_km_s": [0.2, 2.9, 1.5],
               "j2": True}, "eci"),
    "asteroid": ({"kind": "state", "body": {"mu_km3_s2": 10.0, "radius_km": 5.0}, "position_km": [8, 1, -5],
                  "velocity_km_s": [0.2, 0.5, 0.4]}, "hill"),
}  # fmt: skip


@pytest.mark.parametrize("name", [*ORBITS])
def test_other_formulas_give_the_same_forces(name, rng):
    orbit, axes = ORBITS[name]
    moments = np.array((10.0, 400.0, 405.0))
    bodies = Bodies(["one"], [300.0], [moments])
    bodies.position_m[0] = rng.normal(size=3) * 30.0
    bodies.axes[0] = E = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    of_core = Orbit.of(OrbitConfig(**orbit), axes).field()
    uniform = {"kind": "uniform", "acceleration_m_s2": [1e-5, 2e-5, -3e-5]}
    known = KnownFields({"environment": {"orbit": orbit, "world_axes": axes, "fields": [uniform]}})
    for time_s in (0.0, 17.3, 4000.0):
        bodies.force_N, bodies.torque_N_m = 300.0 * np.array(uniform["acceleration_m_s2"]), 0.0
        of_core.add_wrenches(time_s, bodies)
        wrench = known.wrench(time_s, 300.0, bodies.position_m[0], E * moments @ E.T)
        for found, expected in zip(np.split(wrench, 2), (bodies.force_N[0], bodies.torque_N_m[0]), strict=True):
            # Under J2 the reference is integrated to some 1e-5 m of 7e6 m by either; otherwise rounding.
            np.testing.assert_allclose(found, expected, rtol=0, atol=2e-11 * np.linalg.norm(expected))


def test_what_a_field_of_a_user_does_is_not_known(tmp_path):
    drag = {"fields": [{"kind": "drag_constant", "coefficient_kg_s": 0.1}]}
    run = ffsm_mj.run(grasping(tmp_path, environment=drag), fields=[DragConstant])
    assert run.grasps
    assert "grasp twist" in independent(run)
    assert not {"grasp load", "field impulse"} & set(independent(run))
