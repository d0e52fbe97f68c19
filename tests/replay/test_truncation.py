"""A check that fails by the truncation of the step alone says so; wrong physics put in on purpose never passes for that."""

from __future__ import annotations

import json

import mujoco
import pytest

import ffsm_mj
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.impact.model import ImpactModel
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.pytest_plugin import assert_conserved
from ffsm_mj.replay import replay_log
from ffsm_mj.verification.checks import TRUNCATION_CHECKS
from tests.simulation.test_accuracy import whirling


def failing(checks):
    return [check for check in checks if not check.passes]


@pytest.fixture(scope="module")
def truncated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truncated")
    return ffsm_mj.run(whirling(folder), out=folder / "run", rerun=False)


def test_the_residual_falls_with_the_fourth_power_and_says_so(truncated):
    broken = failing(truncated.checks())
    assert broken
    for check in broken:
        assert check.name in TRUNCATION_CHECKS
        assert check.fails_by_truncation
        # The fourth power gives 16; at 0.1 rad a step the next order still counts.
        assert 8.0 < check.truncation.residual / check.truncation.half < 32.0
        assert check.truncation.left < 1e-2 * check.tolerance
        assert "at 10 ms" in check.truncation.sentence(check.unit)
        assert "at 5 ms" in check.truncation.sentence(check.unit)


def test_run_and_log_say_the_same(truncated):
    again = {(check.name, check.subsystem): check for check in replay_log(truncated.log).checks()}
    for check in failing(truncated.checks()):
        assert again[check.name, check.subsystem].truncation == check.truncation


def test_half_the_step_leaves_what_is_told(tmp_path, truncated):
    """The residual of another run at half the step: its states differ by truncation, so the two agree roughly."""
    half = {(check.name, check.subsystem): check for check in ffsm_mj.run(whirling(tmp_path, time_step_s=0.005)).checks()}
    for check in failing(truncated.checks()):
        assert half[check.name, check.subsystem].residual == pytest.approx(check.truncation.half, rel=0.05)


def test_codes_summary_and_messages(truncated, capsys):
    folder = truncated.path.parent
    checks = json.loads((folder / "summary.json").read_text())["checks"]
    assert not checks["passed"]
    assert checks["fail_by_truncation"]
    assert checks["failing"][0]["truncation"]["step_s"] == 0.01
    assert main(["analyze", str(folder)]) == 5
    assert "truncation: " in capsys.readouterr().out
    assert main(["run", str(folder), "--out", str(folder / "again"), "--no-rerun"]) == 5
    assert "by the truncation of the step alone" in capsys.readouterr().err
    with pytest.raises(AssertionError, match=r"by the truncation of the step alone.*\n.*at 10 ms"):
        assert_conserved(truncated)


def losing(share):
    """A motion that loses a share of all rates in each step: ``share(duration)``."""
    honest = Motion.step

    def step(self, duration_s):
        clear = honest(self, duration_s)
        self.data.qvel[:] *= 1.0 - share(duration_s)
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_mulM(self.model, self.data, self.momentum, self.data.qvel)
        return clear

    return step


# At rates of 10 rad/s truncation is 1e-5 J, what is allowed 2e-8 J: each leak is between the two, 1e-6 J or so.
@pytest.mark.long
@pytest.mark.parametrize(
    "share",
    [lambda h: 1e-7 * h, lambda h: 1e-9 + 0.0 * h, lambda h: 1e-3 * h * h],
    ids=["at a rate", "at each step", "of first order"],
)
@pytest.mark.parametrize("rate", [1.0, 0.1], ids=["with truncation", "without"])
def test_a_leak_is_no_truncation(tmp_path, monkeypatch, share, rate):
    monkeypatch.setattr(Motion, "step", losing(lambda h: share(h) / rate**2))
    path = whirling(tmp_path, rate=rate)
    assert main(["run", str(path), "--out", str(tmp_path / "run"), "--no-rerun"]) == 1
    run = ffsm_mj.load_run(tmp_path / "run")
    assert any(not check.fails_by_truncation for check in failing(run.checks()))
    assert any(not check.fails_by_truncation for check in failing(replay_log(run.log).checks()))


def test_an_impulse_of_the_wrong_sign_is_no_truncation(tmp_path, monkeypatch):
    honest = ImpactModel.exchange

    def booking(self, energies, impact):
        true = honest(self, energies, impact)
        return Exchange(true.energy_J, -true.impulse, true.outside)

    monkeypatch.setattr(ImpactModel, "exchange", booking)
    start = {"shoulder": 0.3, "elbow": 0.9, "b/free": [1.1, 0.7, 0.2, 1, 0, 0, 0]}
    rates = {"shoulder": 4.0, "elbow": -7.0, "robot/free": [0.2, 0, 0, 1, 2, 3], "b/free": [-4, 0, 0, 3, 6, 2]}
    run = ffsm_mj.run(whirling(tmp_path, initial={"joints": start, "rates": rates}))
    assert run.impacts
    assert all(check.fails_by_truncation for check in failing(run.checks()) if check.name == "energy")
    assert any(not check.fails_by_truncation for check in failing(run.checks()) if check.name == "linear momentum")
