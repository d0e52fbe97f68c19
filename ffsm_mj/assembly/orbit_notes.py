"""What a user should know of the orbit of a scenario before it runs."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.fields.config import OrbitConfig
from ffsm_mj.fields.orbit import Orbit
from ffsm_mj.simulation.fields import bodies_of, moving_bodies
from ffsm_mj.tolerances import EPSILON

_FAR_M = 1e4
_HIGH = 20.0
"""Semi-major axis over the radius of the central body: 1.3e5 km of the Earth, where the Moon makes 1e-3 of the tide."""
_FAST_M_S = 100.0
_LONG_REST_S = 1.0


def orbit_lines(assembly: Assembly) -> list[str]:
    """Lines of ``ffsm check`` on the orbit and the other fields; none without any."""
    around = assembly.scenario.environment
    kinds = [field.kind for field in around.fields] if around is not None else []
    kinds += ["magnetorquers"] if assembly.system.magnetorquers else []
    if around is None or around.orbit is None:
        return [f"external fields ({', '.join(kinds)}): their impulse and work enter the balance"] if kinds else []
    orbit, name = Orbit.of(around.orbit, around.world_axes), around.orbit.body
    rate, duration_s = orbit.rate_rad_s, assembly.scenario.duration_s
    R, V = orbit.states(np.zeros(1))
    axes = orbit.lvlh(R, V)[0][0]
    size = f"semi-major axis {orbit.mu ** (1 / 3) / rate ** (2 / 3) / 1e3:.6g} km"
    return [
        f"orbit about {name if isinstance(name, str) else 'a body'}: {size}, rate {rate:.6g} rad/s, period "
        f"{2.0 * math.pi / rate:.1f} s{', with J2' if orbit.oblateness else ''}",
        f"  V-bar ({_vector(axes[:, 0])}), R-bar ({_vector(axes[:, 2])}) in world axes at t = 0; tide {3.0 * rate**2:.3g} "
        "m/s^2 per m along R-bar",
        f"  what is left at rest a distance d along R-bar moves by {_fall(rate, duration_s):.3g} d in the run; largest "
        f"gravity-gradient torque on a body at most {_torque(assembly, orbit):.3g} N m",
        f"external fields ({', '.join(['orbit', *kinds])}): their impulse and work enter the balance",
    ]


def _vector(values: FloatArray) -> str:
    return ", ".join(f"{round(float(value), 4) + 0.0:g}" for value in values)


def _fall(rate: float, time_s: float) -> float:
    """How far a mass that is released at rest in LVLH moves along R-bar, per distance: 3 (1 - cos n t)."""
    return 3.0 * (1.0 - math.cos(min(rate * time_s, math.pi)))


def _torque(assembly: Assembly, orbit: Orbit) -> float:
    """Bound of the torque on one body: 3/2 n^2 times the largest difference of its principal moments."""
    moments = bodies_of(assembly.system).inertia_kg_m2
    radius = float(np.linalg.norm(orbit.states(np.zeros(1))[0]))
    return float(1.5 * orbit.mu / radius**3 * np.ptp(moments, axis=1).max())


def orbit_notes(assembly: Assembly) -> Iterator[str]:
    """Notes on a scenario with an orbit; none without."""
    around, data, system = assembly.scenario.environment, assembly.data, assembly.system
    if around is None or around.orbit is None:
        return
    orbit = Orbit.of(around.orbit, around.world_axes)
    a, radius_m = (orbit.mu / orbit.rate_rad_s**2) ** (1.0 / 3.0), 1e3 * around.orbit.central_body.radius_km
    if a > _HIGH * radius_m:
        yield (
            f"the semi-major axis is {a / 1e3:.4g} km, {a / radius_m:.3g} radii of the central body: there other bodies, "
            "which are left out, are part of the tide; lengths of the orbit are in km, not in m"
        )
    ids, _ = moving_bodies(system)
    far = float(np.linalg.norm(data.xipos[ids], axis=1).max())
    if far > _FAR_M:
        yield (
            f"bodies are {far / 1e3:.4g} km from the origin of the orbit: gaps are rounded to {EPSILON * far:.1g} m, and "
            "what is left out of the field, such as higher harmonics, grows with it; put the origin near what meets"
        )
    if system.fixed:
        names = ", ".join(model.name for model in system.fixed)
        yield (
            f"{names}: fixed objects keep their attitude in the world axes, which do not rotate, and are held against the "
            f"tide; they turn by {math.degrees(orbit.rate_rad_s):.3g} deg/s relative to LVLH; let a station float"
        )
    speeds = [np.linalg.norm(data.qvel[joint.dofs][:3]) for joint in system.joints.values() if joint.kind == "free"]
    if max(speeds, default=0.0) > _FAST_M_S:
        yield f"a body moves at {max(speeds):.4g} m/s relative to the origin of the orbit; is it a velocity in other axes?"
    period_s, orbital = 2.0 * math.pi / orbit.rate_rad_s, around.orbit
    if assembly.scenario.duration_s > period_s and not orbital.j2 and _is_inclined(orbital):
        yield "the run is longer than a period, and J2 is left out: write 'j2: true' where drift of the plane matters"
    if (assembly.scenario.impact.rest_interval_s or 0.0) > _LONG_REST_S:
        yield "impact.rest_interval_s is above 1 s: accelerations in orbit are 1e-5 m/s^2, so slow bounces are taken as rest"


def _is_inclined(orbit: OrbitConfig) -> bool:
    return bool(orbit.inclination_deg) or orbit.kind == "state"
