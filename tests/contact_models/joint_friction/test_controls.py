"""Plausible mistakes, put in on purpose: each is far from the closed form that the tests beside this one hold."""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.contact_models.joint_friction import model
from ffsm_mj.contact_models.joint_friction.model import JointFriction
from ffsm_mj.dynamics.motion import Motion
from tests.contact_models.joint_friction.scenes import changes, gear, rubbing, slider
from tests.scenes import ball

pytestmark = pytest.mark.usefixtures("example_contact_models")


def test_a_decision_by_accelerations_at_a_breakaway(tmp_path, monkeypatch):
    """The acceleration is zero there: it sticks again, and the event is due again at the same instant."""
    decided = JointFriction._decided
    monkeypatch.setattr(JointFriction, "_decided", lambda self, others, before, *a: decided(self, others, 0.0 * before, *a))
    load = [{"kind": "drive", "joint": "s", "slope": 0.4}]
    made = ffsm_mj.run(rubbing(tmp_path, slider(1.0), 0.01, duration_s=3.0, contact_models=load))
    assert made.outcome == "event_limit"
    assert {(before, after) for _, _, before, after in changes(made)} == {(0, 0)}


def test_holds_of_least_norm(tmp_path, monkeypatch):
    """Of two coupled joints one breaks away alone, where its share exceeds its limit: both limits are used up at 1 s."""
    monkeypatch.setattr(model, "least_use", lambda forces, *_: forces)
    load = [{"kind": "drive", "joint": "b", "slope": 0.08}]
    made = ffsm_mj.run(rubbing(tmp_path, gear(), 1e-2, duration_s=0.6, contact_models=load))
    ((_, time_s, *_),) = changes(made)
    assert time_s < 0.5


def test_a_joint_locked_in_an_impact(tmp_path, monkeypatch):
    """Rows that impacts see, too: 1.75 N s on seven kilograms, and not 4/3 N s."""

    def constrained(self, J):
        return J if self.loops is None else self.loops._of_stages().projected(J)

    monkeypatch.setattr(Motion, "constrained", constrained)
    made = ffsm_mj.run(
        rubbing(
            tmp_path,
            slider(3.0, hull=False),
            objects={"ball": ball("ball")},
            duration_s=0.12,
            initial={"joints": {"ball/free": [0.3, 0, 0, 1, 0, 0, 0]}, "rates": {"ball/free": [-1, 0, 0, 0, 0, 0]}},
            contacts={"rules": [{"between": ["mass", "ball/ball"], "restitution": 1.0}]},
        )
    )
    (hit,) = made.impacts
    assert hit.impulse_N_s == pytest.approx(1.75, abs=1e-12)
