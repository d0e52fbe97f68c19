"""No tunnelling: a 1 mm plate and a 20 mm ball, up to 1000 m/s, spinning, at any offset, at steps up to 10 ms.

The detector alone, so that hundreds of passes take seconds. The reference is the same flight at steps of 0.01 ms.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.impact.time_of_impact import Detector
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from tests.scenes import HEAD, box, compile_paths

SPIN = 50.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A ball with a knob, so that its spin matters, and a thin free plate."""
    folder = tmp_path_factory.mktemp("tunnel")
    (folder / "ball.xml").write_text(f"""<mujoco>{HEAD}<worldbody><body name="ball"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="0.1" diaginertia="1e-5 1e-5 1e-5"/>
      <geom name="ball" type="ellipsoid" size="0.01 0.008 0.009" mass="0"/></body></worldbody></mujoco>""")
    (folder / "plate.xml").write_text(box("plate", mass=10.0, half=(0.0005, 0.3, 0.3)))
    system = compile_paths(folder / "ball.xml", {"plate": folder / "plate.xml"})
    return system, mujoco.MjData(system.mj)


def first_touch(system, data, speed, step, offset, *, start=0.0):
    """Time at which the ball touches the plate, integrated in steps from a start time."""
    pair = ContactPair(system, "hit", "ball", "plate/plate", 1.0)
    mujoco.mj_resetData(system.mj, data)
    x = -0.25 * min(speed, 20.0) + speed * start
    data.qpos[:7] = (x, offset[0], offset[1], 1, 0, 0, 0)
    # Isotropic inertia: the spin is constant and its angle known.
    turn = SPIN * start
    data.qpos[3:7] = (np.cos(turn / 2), 0, 0.6 * np.sin(turn / 2), 0.8 * np.sin(turn / 2))
    data.qvel[:6] = (speed, 0, 0, 0, 0.6 * SPIN, 0.8 * SPIN)
    mujoco.mj_forward(system.mj, data)
    course = EventDrivenIntegrator(Motion(system.mj, data), [Detector(Scene(system, data), [pair])])
    time = start
    while time < start + 0.3:
        elapsed, contact_model = course.advance(step)
        if contact_model is not None:
            return time + elapsed
        time += step
    return None


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("speed", [1000.0, 100.0, 10.0])
@pytest.mark.parametrize("score", range(10))
def test_the_same_touch_at_any_step_and_offset(flight, speed, score):
    system, data = flight
    rng = np.random.default_rng([20240601, score])
    for _ in range(20):
        offset = rng.uniform(-0.29, 0.29, 2)
        found = [first_touch(system, data, speed, step, offset) for step in (0.001, 0.005, 0.01)]
        assert None not in found, offset
        start = np.floor((min(found) - 2e-4) / 1e-5) * 1e-5
        reference = first_touch(system, data, speed, 1e-5, offset, start=max(start, 0.0))
        assert found == pytest.approx(3 * [reference], abs=1e-9)


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_just_past_the_edge_there_is_no_impact(flight, step):
    """20 mm of ball, 0.3 m of half plate: at 0.311 m it passes, at any speed."""
    system, data = flight
    for speed in (10.0, 1000.0):
        assert first_touch(system, data, speed, step, (0.3105, 0.0)) is None
