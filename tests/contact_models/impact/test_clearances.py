"""Many pairs and light links: no contact is missed, and pairs that are far cost almost no distance queries."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.motion_bound import speeds_per_root_energy
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.impact.time_of_impact import Clearances, Detector
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from tests.scenes import HEAD, compile_paths

FINGERS, KNOBS = 6, 5


@pytest.fixture(scope="module")
def hand(tmp_path_factory):
    """A heavy base with fingers of a gram on hinges and slides, and a rock with knobs: 30 pairs."""
    folder = tmp_path_factory.mktemp("hand")
    fingers = "".join(
        f"""<body name="finger{i}" pos="{0.1 * i - 0.25} 0 0.2"><joint name="finger{i}" {kind} axis="0 1 0"/>
        <geom name="finger{i}" type="capsule" fromto="0 0 0 0 0 0.15" size="0.01" mass="0.001"/></body>"""
        for i, kind in enumerate(("", 'type="slide"') * (FINGERS // 2))
    )
    (folder / "hand.xml").write_text(f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="50" diaginertia="5 5 5"/>{fingers}</body></worldbody></mujoco>""")
    knobs = "".join(f'<geom name="knob{i}" size="0.04" pos="{0.1 * i - 0.2} 0 0.1" mass="2"/>' for i in range(KNOBS))
    (folder / "rock.xml").write_text(
        f'<mujoco>{HEAD}<worldbody><body name="rock"><freejoint name="free"/>{knobs}</body></worldbody></mujoco>'
    )
    system = compile_paths(folder / "hand.xml", {"rock": folder / "rock.xml"})
    return system, mujoco.MjData(system.mj)


def course_of(system, data, rng, *, away):
    """The rock on its way past the fingers, all of them in motion."""
    mujoco.mj_resetData(system.mj, data)
    joints = {name: system.mj.joint(name) for name in ("robot/free", "rock/free")}
    data.qvel[:] = 0.5 * rng.normal(size=system.mj.nv)
    place, velocity = joints["rock/free"].qposadr[0], joints["rock/free"].dofadr[0]
    data.qpos[place : place + 3] = (0.0, 0.0, away)
    data.qvel[velocity : velocity + 3] = rng.normal(size=3) * 0.2 - np.array((0.0, 0.0, 2.0 * away))
    mujoco.mj_forward(system.mj, data)
    pairs = [
        ContactPair(system, f"{i}-{k}", f"robot/finger{i}", f"rock/knob{k}", 1.0)
        for i in range(FINGERS)
        for k in range(KNOBS)
    ]
    detector = Detector(Scene(system, data), pairs)
    return EventDrivenIntegrator(Motion(system.mj, data), [detector]), pairs


def first_touch(system, data, seed):
    course, _ = course_of(system, data, np.random.default_rng(seed), away=1.0)
    for step in range(600):
        elapsed, contact_model = course.advance(0.002)
        if contact_model is not None:
            return step + elapsed / 0.002, data.qpos.copy()
    return None


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_the_first_touch_is_that_of_evaluating_all_pairs_in_every_step(hand, monkeypatch, seed):
    system, data = hand
    found = first_touch(system, data, seed)
    monkeypatch.setattr(Clearances, "after_step", lambda self: np.flatnonzero(~self._skipped))
    every = first_touch(system, data, seed)
    assert (found is None) == (every is None)
    if found is not None:
        assert found[0] == every[0]
        assert np.array_equal(found[1], every[1])


def test_distant_pairs_are_hardly_evaluated(hand, monkeypatch):
    """By energy alone, which says little of a finger of a gram, all 30 pairs would be evaluated in each of 500 steps."""
    system, data = hand
    course, pairs = course_of(system, data, np.random.default_rng(1), away=5.0)
    data.qvel[:] *= 0.1
    course.restart()
    assert speeds_per_root_energy(system.mj, data, [pair.ids for pair in pairs]).max() > 50.0
    queries = []
    query = ContactPair.gap
    monkeypatch.setattr(ContactPair, "gap", lambda self, *args: queries.append(self) or query(self, *args))
    for _ in range(500):
        course.advance(0.002)
    assert len(queries) < 2 * len(pairs)


def test_a_slide_that_runs_away_renews_the_bounds(hand):
    """A finger that slides 20 m off the hand lengthens every lever: a rock out there is hit nevertheless."""
    system, data = hand
    course, _ = course_of(system, data, np.random.default_rng(0), away=1.0)
    data.qvel[:] = 0.0
    finger, rock = system.mj.joint("robot/finger1"), system.mj.joint("rock/free")
    data.qvel[finger.dofadr[0]] = 20.0
    data.qpos[rock.qposadr[0] : rock.qposadr[0] + 3] = (-0.15, 20.0, 0.2)
    mujoco.mj_forward(system.mj, data)
    course.restart()
    hit_s = 0.0
    contact_model = None
    while contact_model is None and hit_s < 2.0:
        elapsed, contact_model = course.advance(0.002)
        hit_s += elapsed
    # Masses of 1 g and 50 kg: the finger slides at constant speed over the base to 1e-4.
    knob_at = 20.0 - 0.05
    assert hit_s == pytest.approx(knob_at / 20.0, rel=1e-3)
