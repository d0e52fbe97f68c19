"""Impacts with another status than ``ok``: record, sentence, summary and ``analyze`` agree."""

from __future__ import annotations

import json
import math

import pytest

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.impact.records import IMPACT
from tests.contact_models.impact.test_fixed import slab
from tests.contact_models.impact.test_friction_runs import PUSH, impact_energy_check
from tests.replays import proved
from tests.scenes import ball, scene


def oblique(folder, e=1.0, mu=1.0, **scenario):
    """A ball on one slide, two across for one towards, meets a fixed wall at 0.67 s: its motions there are coupled."""
    pair = {"between": ["ball", "wall/wall"], "restitution": e, "mu": mu}
    return scene(
        folder,
        ball("ball", mass=2.0, joints="x").replace('axis="1 0 0"', 'axis="1 2 0"'),
        {"wall": slab("wall", "0.1 2 2")},
        fixed={"wall": {"position_m": [0.5, 0, 0]}},
        **{"initial": {"rates": {"robot/x": 1.0}}, "contacts": {"rules": [pair]}, "duration_s": 0.72} | scenario,
    )


@pytest.mark.parametrize("e", [0.5, 1.0])
def test_a_ball_that_locks_itself_is_wedged(tmp_path, capsys, e):
    """On one slide u_t = 2 u_n: both end together, friction of |f| = 1/2 < mu keeps it closed, and all energy is lost.

    The wall is 0.3 m away, 0.3 sqrt(5) m along the slide; impulses along it are m v: (n + 2 t) / sqrt(5) = 2 N s, t = mu n.
    """
    run = proved(ffsm_mj.run(oblique(tmp_path, e=e), out=tmp_path / "run", rerun=False))
    assert run.outcome == "completed"
    (hit,) = run.impacts
    assert (hit.status, hit.law) == ("wedged", "stronge")
    assert hit.time_s == pytest.approx(0.3 * math.sqrt(5.0), abs=1e-12)
    assert hit.impulse_N_s == pytest.approx(2.0 * math.sqrt(5.0) / 3.0, rel=1e-12)
    assert math.hypot(*hit.tangential_impulse_N_s) == pytest.approx(hit.impulse_N_s, rel=1e-12)
    assert hit.separation_speed_m_s == pytest.approx(0.0, abs=1e-12)
    assert run["state.v_robot_x_m_s"][-1] == pytest.approx(0.0, abs=1e-12)
    assert run["energy.total_J"][-1] == pytest.approx(0.0, abs=1e-14)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["impacts"][0]["status"] == "wedged"
    assert "wedged" in IMPACT.sentence(hit)
    assert main(["analyze", str(tmp_path / "run")]) == 0
    assert "wedged" in capsys.readouterr().out
    assert not impact_energy_check(run, status="ok").passes


def test_a_wedged_contact_under_load_stays_at_rest(tmp_path):
    """The slide meets the wall inside the friction cone: friction holds it against any push along the slide."""
    push = [{"name": "push", "until": "end", "controller": PUSH}]
    run = proved(ffsm_mj.run(oblique(tmp_path, phases=push, duration_s=0.36)))  # it meets the wall at 0.32 s
    assert [hit.status for hit in run.impacts] == ["wedged"]
    assert run.outcome == "completed"
    assert abs(run["state.v_robot_x_m_s"][-1]) < 1e-12
