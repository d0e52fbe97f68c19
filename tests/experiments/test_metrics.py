"""What is measured of a run, against the run itself."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.effort import Effort
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.assembly.run import simulate
from ffsm_mj.experiments import metrics
from ffsm_mj.experiments.metrics import columns_of, fault_of, metric_values
from ffsm_mj.log.scenario import compile_log


def measured(scenario: str, overrides: dict[str, Any], names: list[str]) -> tuple[Run, dict[str, Any]]:
    run = ffsm_mj.run(scenario, overrides)
    return run, metric_values(run, names) | {"effort": ffsm_mj.effort(run)}


@pytest.fixture(scope="module")
def baseline() -> tuple[Run, dict[str, Any]]:
    return measured("baseline", {"duration_s": 9.0}, ["impacts.0.impulse_N_s", "impacts.1.impulse_N_s", "tip.min_error_m"])


def test_scalars_of_the_summary_by_path(baseline: tuple[Run, dict[str, Any]]) -> None:
    run, told = baseline
    assert told["impacts.0.impulse_N_s"] == run.impacts[0].impulse_N_s
    assert told["impacts.1.impulse_N_s"] is None  # there is one impact
    assert told["impacts.count"] == 1
    assert told["tip.min_error_m"] == run.tip_error().min()


def test_laws_are_judged_from_the_accumulator(baseline: tuple[Run, dict[str, Any]]) -> None:
    run, told = baseline
    assert told["checks_pass"] is True
    assert told["checks.energy"] == max(check.residual for check in all_checks(run) if check.name == "energy")
    assert 0.0 < told["drift"] < 1e-9
    assert (
        told["deepest_overlap_m"]
        == max(check.residual for check in all_checks(run) if check.name == "no penetration")
        < 1e-15
    )


def test_a_violated_law_counts_as_failed() -> None:
    law = SimpleNamespace(name="energy", residual=2.0, drift=2.0, tolerance=1.0, passes=False, fails_by_truncation=False)
    assert metrics.check_metrics([law])["checks_pass"] is False  # type: ignore[list-item]


def test_a_check_that_fails_tells_its_residual_over_its_tolerance() -> None:
    """The worst of its subsystems; one that passes tells nothing, one without a number an infinite excess."""

    def law(name: str, residual: float, tolerance: float) -> Any:
        passes = residual <= tolerance
        numbers = {"residual": residual, "drift": residual, "tolerance": tolerance}
        return SimpleNamespace(name=name, **numbers, passes=passes, fails_by_truncation=False)

    laws = [law("energy", 6.0, 2.0), law("energy", 5.0, 1.0), law("energy", 8.0, 9.0), law("linear momentum", 1.0, 2.0)]
    told = metrics.check_metrics([*laws, law("no penetration", float("nan"), 1e-9)])
    assert {name: value for name, value in told.items() if name.startswith("excess.")} == {
        "excess.energy": 5.0,
        "excess.no_penetration": float("inf"),
    }
    assert fault_of("excess.energy", []) is None


def test_effort_of_joint_motors(baseline: tuple[Run, dict[str, Any]]) -> None:
    """Efforts are held from row to row, so sums over rows are the integrals.

    Work is that of the balance but for the tick of the impact, in which efforts change between two rows: 14 N m at most,
    over 1 ms, at 1 rad/s.
    """
    run, told = baseline
    applied = run["actuators.robot_motor_2_applied_N_m"]
    effort = told["effort"]["robot_motor_2"]
    assert effort["integral_u2"] == pytest.approx(float(np.sum(applied[:-1] ** 2 * np.diff(run.time))), rel=1e-12)
    assert effort["peak"] == np.abs(applied).max()
    upper, lower = run["actuators.robot_motor_2_upper_N_m"], run["actuators.robot_motor_2_lower_N_m"]
    assert effort["at_bound"] == pytest.approx(np.mean((applied >= upper) | (applied <= lower)))
    work = sum(each["work_J"] for each in told["effort"].values())
    assert work == pytest.approx(run["balance.work_J"][-1], abs=14e-3)


def test_effort_of_thrusters_at_sites() -> None:
    """Power by the trapezoidal rule: its error falls as the square of the step; here 10 ms of a slow motion."""
    run, told = measured("free-flying", {"duration_s": 5.0}, [])
    work = sum(each["work_J"] for each in told["effort"].values())
    scale = sum(abs(each["work_J"]) for each in told["effort"].values())
    assert scale > 0.0
    assert work == pytest.approx(run["balance.work_J"][-1], abs=1e-3 * scale)


def test_effort_does_not_depend_on_blocks(baseline: tuple[Run, dict[str, Any]]) -> None:
    """Blocks are cut by the clock: sums that depended on them would differ from run to run."""
    run, _ = baseline
    cut = Effort(compile_log(run.log))
    cut.open(run.log.header)
    for first in range(0, len(run.log.rows), 7):
        cut.rows(run.log.rows[first : first + 7])
    assert cut.summary() == {
        "effort": ffsm_mj.effort(run),
        "base_rotation": ffsm_mj.base_rotation(run),
        "angular_momentum": ffsm_mj.angular_momentum(run),
    }
    assert ffsm_mj.effort(Run(run.log)) == ffsm_mj.effort(run)  # of the log alone


def test_metrics_of_somebody(monkeypatch: pytest.MonkeyPatch) -> None:
    """A function on a run; what it names of columns is all that is kept."""

    def swing(run: Run) -> float:
        assert run.keys == ("state.time_s", "state.q_robot_joint_1_rad")
        return np.float64(np.ptp(run["state.q_robot_joint_1_rad"]))

    swing.columns = ("state.q_robot_joint_1_rad",)  # type: ignore[attr-defined]
    monkeypatch.setattr(metrics, "plugin_metrics", lambda: {"swing": swing, "kind": lambda run: run})
    assembly = prepare("baseline", {"duration_s": 1.0}).assemble()
    run = simulate(assembly, columns=columns_of(["swing"]))
    whole = ffsm_mj.run("baseline", {"duration_s": 1.0})["state.q_robot_joint_1_rad"]
    found = metric_values(run, ["swing"])["swing"]
    assert (type(found), found) == (float, np.ptp(whole))
    assert columns_of(["swing", "kind"]) is None  # the second does not say what it needs
    with pytest.raises(ValueError, match="metric 'kind' is no number, text or flag but a Run"):
        metric_values(run, ["kind"])


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("tip.min_error_m", None),
        ("impacts.0.impulse_N_s", None),
        ("impacts.0.qvel_after.robot/joint_1", None),
        ("contacts.0.peak_force_N", None),
        ("phases.1.end_s", None),
        ("grasps.0.loss_J", None),
        ("near_misses.count", None),
        ("tip.target_m.2", None),
        ("effort.robot_motor_1.work_J", None),
        ("controller.phases.0.reports.riccati_fallbacks", None),
        ("tip.min_eror_m", "did you mean 'tip.min_error_m'?"),
        ("impacts.0.impulse", "did you mean 'impulse_N_s'?"),
        ("impacts.first.impulse_N_s", "impacts is a list"),
        ("effort.robot_motor_9.work_J", "unknown metric"),
    ],
)
def test_names_are_checked(name: str, fault: str | None) -> None:
    found = fault_of(name, ["robot_motor_1"])
    assert found is None if fault is None else fault in (found or "")


def test_a_partial_run_in_memory_is_the_whole_one() -> None:
    """Only named columns are kept; verdicts and summary are those of the whole run."""
    whole = ffsm_mj.run("coasting", {"duration_s": 2.0})
    part = simulate(prepare("coasting", {"duration_s": 2.0}).assemble(), columns=("energy.total_J",))
    assert part.keys == ("state.time_s", "energy.total_J")
    np.testing.assert_array_equal(part["energy.total_J"], whole["energy.total_J"])
    assert all_checks(part) == all_checks(whole)
    timeless = dict.fromkeys(("wall_s", "real_time_factor", "law_wall_s_per_tick"), 0.0)
    assert ffsm_mj.summary(part) | timeless == ffsm_mj.summary(whole) | timeless
