"""The comparison of control laws: tables say no more than their intervals, points are shared, the reach is the arm's."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "law_comparison"))
from differences import balance, gain
from floor import REACH_M
from laws import LAWS
from rows import points
from table import METRICS, Table, TableRow


def table(osdre, other):
    """Costs of two laws in the same runs; NaN stands for a run that fails a check."""
    rows = []
    for law, costs in (("osdre", osdre), ("sdre", other)):
        for run, cost in enumerate(costs):
            metrics = dict.fromkeys(METRICS, 0.0) | {"cost": cost}
            good = not math.isnan(cost)
            rows.append(TableRow("baseline", law, "tuned", (1.0, 1.0), run, 2, "completed", good, metrics))
    return Table(rows)


OTHER = [3.0, 1.0, 4.0, 1.5, 5.0, 9.0, 2.0, 6.0]


@pytest.mark.parametrize(
    ("shift", "says"),
    [([-0.3] * 8, "-7.6 % [-0.3, -0.3]"), ([0.3, -0.3] * 4, "none shown"), ([0.9, -0.1] * 4, "+10 %")],
)
def test_a_difference_is_named_only_where_its_interval_excludes_zero(shift, says):
    """The mean of the second case is 0; that of the third 0.4 of 3.9."""
    found = gain(table(np.add(OTHER, shift), OTHER), "baseline", "tuned", "cost", "osdre", "sdre")
    assert found.told().startswith(says)


def test_a_run_that_is_not_good_with_one_law_counts_for_neither():
    """Its cost would turn the sign."""
    osdre = [math.nan, *np.subtract(OTHER, 0.3)[1:]]
    found = gain(table(osdre, [0.0, *OTHER[1:]]), "baseline", "tuned", "cost", "osdre", "sdre")
    assert found.difference.n == 7
    assert found.difference.mean == pytest.approx(-0.3)
    assert balance([found]) == "less in 1, more in 0, and no difference is shown in 0 of 1 rows"


def test_five_pairs_show_nothing():
    """Five differences of one sign have a probability of 1/16."""
    found = gain(table(np.subtract(OTHER, 0.3)[:5], OTHER[:5]), "baseline", "tuned", "cost", "osdre", "sdre")
    assert found.told() == "none shown"


def test_more_points_extend_fewer_and_lie_in_the_ranges():
    assert points(16)[:8] == points(8)
    for law in LAWS:
        for point in points(16):
            for parameter, value in zip(law.parameters, law.at(point), strict=True):
                assert 0.999 * parameter.low <= value <= 1.001 * parameter.high


def test_reach_is_that_of_the_stretched_arm():
    """Maximised over joint angles with the masses of the model: no arm reaches farther, and one gets there."""
    masses, mount = (5.0, 2.0, 2.0, 2.0, 1.0), np.array([0.9, -0.4])

    def distance(angles):
        ends = mount + np.cumsum([[2 * math.cos(a), 2 * math.sin(a)] for a in angles], axis=0)
        middles = [*(ends - [[math.cos(a), math.sin(a)] for a in angles]), ends[-1]]
        centre = sum(m * np.asarray(at) for m, at in zip(masses[1:], middles, strict=True)) / 12.0
        return math.hypot(*(ends[-1] - centre))

    along = math.atan2(-0.4, 0.9)
    assert distance([along] * 3) == pytest.approx(REACH_M, abs=1e-12)
    tried = np.random.default_rng(0).uniform(-math.pi, math.pi, (2000, 3))
    assert max(map(distance, tried)) < REACH_M
