"""Sensitivity against Ishigami's function, whose indices are known; failures by what sets them apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from ffsm_mj.experiments.design import unit_cube_points
from ffsm_mj.experiments.statistics import Estimate, groups, holm, parameter_differences, rank_correlation, sobol_indices
from tests.experiments.made_up import results, row

N = 1024
NAMES = ("x1", "x2", "x3")


@pytest.fixture(scope="module")
def ishigami():
    """Rows of a Saltelli design with y = sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1, x in [-pi, pi]."""
    x = np.pi * (2.0 * unit_cube_points("saltelli", N, 20240, NAMES) - 1.0)
    y = np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    return [row(i, y=float(y[i]), **dict(zip(NAMES, map(float, x[i]), strict=True))) for i in range(len(x))]


def test_ishigami(ishigami):
    """S = .314 .442 0 and total .558 .442 .244, known exactly; 0.02 is what 1024 Sobol points leave."""
    found = sobol_indices(results(ishigami, kind="saltelli", n=N), "y")
    assert [*found] == [*NAMES]
    assert [first.value for first, _ in found.values()] == pytest.approx([0.314, 0.442, 0.0], abs=0.02)
    assert [total.value for _, total in found.values()] == pytest.approx([0.558, 0.442, 0.244], abs=0.02)
    assert all(index.low < index.value < index.high for indices in found.values() for index in indices)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[:-3], "3 runs have no result yet"),
        (lambda rows: [*rows[:7], rows[7] | {"failed": True}, *rows[8:]], "1 runs failed, first run 7"),
        (lambda rows: [*rows[:7], rows[7] | {"y": None}, *rows[8:]], "1 runs have no y, first run 7"),
        (lambda rows: [each | {"y": 7.769248852} for each in rows], "constant"),
    ],
)
def test_indices_are_refused_rather_than_wrong(ishigami, change, message):
    """One missing number makes all of SciPy's indices 0 without an error."""
    with pytest.raises(ValueError, match=message):
        sobol_indices(results(change(ishigami), kind="saltelli", n=N, runs=len(ishigami)), "y")


def test_a_parameter_without_any_effect_has_index_zero(ishigami):
    """Exactly: f(A) and f(A mixed) are the same numbers, of which SciPy's own bootstrap makes NaN."""
    rows = [each | {"y": each["x1"]} for each in ishigami]
    first, *others = sobol_indices(results(rows, kind="saltelli", n=N), "y").values()
    assert first[0].value == pytest.approx(1.0, abs=0.02)
    assert {index for indices in others for index in indices} == {Estimate(0.0, 0.0, 0.0)}


def test_indices_need_more_than_a_handful_of_points(ishigami):
    with pytest.raises(ValueError, match="n = 4 is too small for Sobol indices"):
        sobol_indices(results(ishigami[:20], kind="saltelli", n=4), "y")


def test_indices_need_their_own_design(ishigami):
    with pytest.raises(ValueError, match="need samples of kind saltelli, not sobol"):
        sobol_indices(results(ishigami, kind="sobol"), "y")


def test_ranks_and_not_values_are_correlated():
    rows = [row(i, x=float(i), x_of_text="a", x_flat=1.0, y=float(np.exp(i)), y_flat=2.0) for i in range(50)]
    found = results(rows)
    assert rank_correlation(found, "x", "y") == pytest.approx(1.0)
    assert rank_correlation(found, "x_of_text", "y") is None
    assert rank_correlation(found, "x_flat", "y") is None
    assert rank_correlation(found, "x", "y_flat") is None


def test_runs_without_the_metric_are_left_out_of_correlations():
    rows = [row(i, x=float(i), y=float(-i) if i % 2 else None) for i in range(20)]
    rows += [row(20 + i, outcome="diverged", x=float(i), y=1e9 * i) for i in range(20)]
    assert rank_correlation(results(rows), "x", "y") == pytest.approx(-1.0)


def test_correlations_of_a_saltelli_design_are_those_of_its_independent_rows(ishigami):
    found = results(ishigami, kind="saltelli", n=N)
    first = ishigami[: 2 * N]
    expected = stats.spearmanr([each["x1"] for each in first], [each["y"] for each in first]).statistic
    assert rank_correlation(found, "x1", "y") == expected


def test_failures_in_groups():
    rows = [row(i, success=True) for i in range(5)]
    rows += [
        row(5, outcome="error", message="ValueError: x is bad (law.py:3)"),
        row(6, outcome="error", message="KeyError: 'a'"),
    ]
    rows += [
        row(7, outcome="error", message="ValueError: y is bad"),
        row(8, success=False),
        row(9, failed=True, success=False),
    ]
    rows += [row(10, outcome="diverged") | {"phase": "approach"}, row(11, outcome="diverged"), row(12, outcome="diverged")]
    found = [(group.how, group.phase, group.runs) for group in groups(results(rows))]
    assert found == [
        ("error (ValueError)", "coast", (5, 7)),
        ("diverged", "coast", (11, 12)),
        ("error (KeyError)", "coast", (6,)),
        ("no success", "coast", (8,)),
        ("a check fails", "coast", (9,)),
        ("diverged", "approach", (10,)),
    ]
    assert groups(results(rows))[0].message == "ValueError: x is bad (law.py:3)"


def test_the_parameter_that_makes_runs_fail_is_found():
    """Failure above x_cause = 0.7; of nine others one in twenty would be below 5 % by chance, were it not for Holm."""
    rng = np.random.default_rng(5)
    drawn = rng.random((300, 10))
    rows = [
        row(
            i,
            outcome="completed" if each[0] < 0.7 else "diverged",
            x_cause=each[0],
            **{f"x{k}": each[k] for k in range(1, 10)},
        )
        for i, each in enumerate(drawn)
    ]
    found = parameter_differences(results(rows))
    assert (found.index[0], found["statistic"].iloc[0]) == ("x_cause", 1.0)
    assert found["probability"].iloc[0] < 1e-6
    assert all(found["probability"].iloc[1:] > 0.05)


def test_no_difference_is_told_from_a_handful():
    rows = [row(i, x=float(i), outcome="completed" if i >= 4 else "diverged") for i in range(100)]
    assert parameter_differences(results(rows)).empty
    one_more = results([*rows, row(100, x=-1.0, outcome="diverged")])
    assert [*parameter_differences(one_more).index] == ["x"]


def test_holm():
    """The printed example of three: 0.01, 0.04, 0.03 become 3 x 0.01, 2 x 0.03, and no less than that."""
    assert holm(np.array([0.01, 0.04, 0.03])) == pytest.approx([0.03, 0.06, 0.06])
    assert holm(np.array([0.6, 0.9])).tolist() == [1.0, 1.0]
    assert holm(np.array([])).tolist() == []
