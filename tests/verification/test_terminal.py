"""``terminal``: what is left at the end of a run, as checks with the bounds of the scenario."""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.assembly.run import simulate
from ffsm_mj.replay import replay_log
from tests.contact_models.grasp.scenes import grasping
from tests.scenes import ball, scene

KEYS = ("stack_momentum_N_m_s", "base_rate_rad_s", "base_speed_m_s", "relative_rate_rad_s")


def at_end(checks):
    return {check.name.removesuffix(" at the end"): check for check in checks if check.name.endswith(" at the end")}


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_rates_at_the_end_are_bounded(tmp_path, factor):
    """Spheres coast as they begin: rate |(3, 0, 4)|, speed |(0.6, 0.8, 0)| of the base, and |(0, 2, 0)| between them."""
    rates = {"robot/free": [0.6, 0.8, 0, 3, 0, 4], "near/free": [0.6, 0.8, 0, 3, 2, 4], "far/free": [0, 0, 0, 3, 0, 4]}
    places = {f"{name}/free": [x, 0, 0, 1, 0, 0, 0] for name, x in (("near", 9.0), ("far", -9.0))}
    left = dict(zip(KEYS, (0.4 * 0.01 * 5.0, 5.0, 1.0, 2.0), strict=True))
    path = scene(
        tmp_path,
        ball("ball"),
        {"near": ball("near"), "far": ball("far")},
        initial={"joints": places, "rates": rates},
        duration_s=1e-3,
        terminal={key: factor * value for key, value in left.items()},
    )
    run = ffsm_mj.run(path)
    of_campaign = simulate(prepare(path).assemble(), columns=())  # which keeps no rows
    for checks in (all_checks(run), replay_log(run.log).checks(), all_checks(of_campaign)):
        found = at_end(checks)
        assert [*found] == ["stack momentum", "base rate", "base speed", "relative rate"]
        for check, value in zip(found.values(), left.values(), strict=True):
            assert check.residual == pytest.approx(value, rel=1e-9)
            assert check.passes == (factor > 1.0)
    run = ffsm_mj.run(path, {"terminal.stack_momentum_N_m_s": None, "terminal.relative_rate_rad_s": None})
    assert [*at_end(all_checks(run))] == ["base rate", "base speed"]


def test_of_a_grasp_the_grasped_object_counts(tmp_path):
    """Held by joints that come to rest it turns with the base, while another object turns on."""
    initial = {
        "joints": {"target/free": [1.3, 0.03, 0.02, 1, 0, 0, 0], "spare/free": [0, 9, 0, 1, 0, 0, 0]},
        "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3], "spare/free": [0, 0, 0, 0, 0, 7]},
    }
    bound = {"stack_momentum_N_m_s": None, "relative_rate_rad_s": 1e-3}
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": {"kind": "off"}},
        {"name": "hold", "until": "end", "controller": {"kind": "hold", "bandwidth_rad_s": 10.0}},
    ]
    path = grasping(tmp_path / "scene", others={"spare": ball("spare")}, initial=initial, phases=phases, terminal=bound)
    run = ffsm_mj.run(path)
    (check,) = at_end(all_checks(run)).values()
    assert run.grasps[0].release_s is None
    assert check.passes, check.residual
