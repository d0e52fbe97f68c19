"""Wrong code put in on purpose: runs of it are not reported as good."""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact_models.persistent.closed_contacts import ClosedContacts
from ffsm_mj.replay import replay_log
from tests.scenes import self_hit, two_balls

PUSH = {"kind": "pd", "joints": ["robot/x"], "kp": 5.0, "kd": 0.0, "target": [3.0]}
PRESS = {"kind": "pd", "joints": ["elbow"], "kp": 4.0, "kd": 2.0, "target": [3.0]}


def pushed(folder):
    """A ball at rest on another is pushed from the start."""
    phases = [{"name": "push", "until": "end", "controller": PUSH}]
    return two_balls(folder, speed=0.0, gap=0.0, restitution=0.0, phases=phases, duration_s=0.01)


def slid(folder):
    """A tip slides over an edge of its own hull."""
    phases = [{"name": "press", "until": "end", "controller": PRESS}]
    return self_hit(folder, restitution=0.3, phases=phases, duration_s=1.7)


def faults(run):
    """Names of what is wrong with it, by the log's own accounts, and by what its states say with the right code."""
    return {check.name for check in all_checks(run) if not check.passes} | ({run.outcome} - {"completed"})


def judged(run):
    """The same by the states, with whatever code is in now."""
    again = replay_log(run.log)
    return {check.name for check in again.checks() if not check.passes} | ({"motion"} if not again.agrees else set())


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("scene", [pushed, slid])
def test_right_code_is_good(tmp_path, scene):
    run = ffsm_mj.run(scene(tmp_path))
    assert faults(run) == judged(run) == set()


@pytest.mark.long
@pytest.mark.slow
def test_a_forgotten_re_detection_is_noticed(tmp_path, monkeypatch):
    """The face goes on for ever: what is held beyond its edge touches nothing."""
    with monkeypatch.context() as wrong:
        wrong.setattr(ClosedContacts, "pairs_outside_feature", lambda _: [])
        slack = ClosedContacts.witness_value

        def blind(self, **exact):
            rows = self.decide().rows if self.contact_points else None
            return slack(self, **exact) if rows is None or min(at.inside for at in rows.states) > 0.0 else 1.0

        wrong.setattr(ClosedContacts, "witness_value", blind)
        run = ffsm_mj.run(slid(tmp_path))
    assert not run.records["contact_changes"]
    assert "contact complementarity" in judged(run)
