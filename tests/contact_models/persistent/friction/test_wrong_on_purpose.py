"""Wrong code of contacts put in on purpose: a replay of its logs with the right code finds forces that cannot be."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.persistent.closed_contacts import ClosedContacts
from ffsm_mj.contact_models.persistent.friction import choice
from ffsm_mj.contact_models.persistent.friction.modes import SLIDE, STICK
from ffsm_mj.replay import replay_log
from tests.contact_models.persistent.friction.scenes import BALL_TIP, block, cube, gripped, load, thrust
from tests.scenes import self_hit


def freed_one_at_a_time(monkeypatch):
    """Of the points beyond their limit only one is freed; the others stick until the next choice of modes."""

    def wrong(self):
        still = self._still
        kinds = np.where(still, np.where(self._states.kinds == SLIDE, SLIDE, STICK), SLIDE)
        directions = self._directions(kinds)
        found = self.evaluate(kinds, directions)
        friction = np.hypot(*found.forces[:, 1:].T)
        first = np.argmax(np.where(kinds == STICK, friction - self._problem.mu * found.forces[:, 0], -np.inf))
        kinds[first], directions[first] = SLIDE, -found.forces[first, 1:] / friction[first]
        return self.evaluate(kinds, directions)

    monkeypatch.setattr(choice.ModeChoice, "_solved", wrong)


def never_detected_again(monkeypatch):
    """A face goes on for ever: what is held beyond its edge touches nothing."""
    slack = ClosedContacts.witness_value

    def blind(self, **exact):
        rows = self.decide().rows if self.contact_points else None
        return slack(self, **exact) if rows is None or min(at.inside for at in rows.states) > 0.0 else 1.0

    monkeypatch.setattr(ClosedContacts, "pairs_outside_feature", lambda _: [])
    monkeypatch.setattr(ClosedContacts, "witness_value", blind)


def breaks_away(folder):
    """A block at rest that a side load beyond the limit of friction pulls away."""
    pull = load("robot/box", force_N=[[2.0, 3.0, 0]], at_m=[0, 0, -0.05])
    return block(folder, mu=0.3, velocity=(0, 0, 0), weight=10.0, step=4e-3, duration=0.02, loads=[pull])


def pulled_out(folder):
    """A cube between two balls, which the thrust of their base pulls off it."""
    held = cube(2.0, 0.05, 0.004)
    return gripped(folder, BALL_TIP, held, mu=0.4, grip_N=5.0, loads=[thrust((0, 0, 36))], step=4e-3, duration=0.02)


def slid(folder):
    """A tip slides over an edge of its own hull."""
    press = {"kind": "pd", "joints": ["elbow"], "kp": 4.0, "kd": 2.0, "target": [3.0]}
    phases = [{"name": "press", "until": "end", "controller": press}]
    return self_hit(folder, restitution=0.3, phases=phases, duration_s=1.7)


def judged(run):
    """Names of the checks that fail by the states, with whatever code is in now."""
    return {check.name for check in replay_log(run.log).checks() if not check.passes}


@pytest.mark.long
@pytest.mark.parametrize(
    ("mistake", "scene"),
    [(freed_one_at_a_time, breaks_away), (freed_one_at_a_time, pulled_out), (never_detected_again, slid)],
)
def test_a_mistake_is_noticed_in_the_log(tmp_path, monkeypatch, mistake, scene):
    with monkeypatch.context() as wrong:
        mistake(wrong)
        run = ffsm_mj.run(scene(tmp_path))
    assert "contact complementarity" in judged(run)
    assert judged(ffsm_mj.run(scene(tmp_path))) == set()
