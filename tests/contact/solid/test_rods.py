"""Which ends of coaxial cylinders and capsules others continue."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ffsm_mj.contact.solid.rods import Rod, covered_ends

TURN = Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix()
TOLERANCE = 1e-9


def rod(
    start: float, end: float, *, radius: float = 0.05, across: float = 0.0, tilt: float = 0.0, reverse: bool = False
) -> Rod:
    """A rod along one line from start to end, off it by a distance and an angle."""
    axis = np.array([np.sin(tilt), 0.0, np.cos(tilt)]) * (-1.0 if reverse else 1.0)
    return Rod(TURN @ [across, 0.0, 0.5 * (start + end)], TURN @ axis, 0.5 * (end - start), radius)


@pytest.mark.parametrize(
    ("rods", "senses"),
    [
        ([rod(0, 1), rod(1, 3)], [(1.0,), (-1.0,)]),
        ([rod(0, 1), rod(1, 3, reverse=True)], [(1.0,), (1.0,)]),
        ([rod(0, 1), rod(1, 2), rod(2, 3)], [(1.0,), (-1.0, 1.0), (-1.0,)]),
        ([rod(0, 1), rod(0.5, 3)], [(1.0,), (-1.0,)]),
        ([rod(0, 1), rod(-1, 3)], [(-1.0, 1.0), ()]),
        ([rod(0, 1), rod(0, 1)], [(), ()]),
        ([rod(0, 1), rod(0.5, 1)], [(), (-1.0,)]),
        ([rod(0, 1), rod(1 + 1e-10, 3)], [(1.0,), (-1.0,)]),
        ([rod(0, 1), rod(1 + 1e-8, 3)], [(), ()]),
        ([rod(0, 1), rod(1, 3, radius=0.05 + 1e-8)], [(), ()]),
        ([rod(0, 1), rod(1, 3, across=1e-8)], [(), ()]),
        ([rod(0, 1), rod(1, 3, tilt=1e-8)], [(), ()]),
        ([rod(0, 1), rod(1, 3, across=1e-10, radius=0.05 - 1e-10)], [(1.0,), (-1.0,)]),
    ],
)
def test_two_and_three_rods(rods, senses):
    """End to end in either sense, overlapping, the same twice; off by less and by more than the tolerance."""
    ends = covered_ends(rods, TOLERANCE)
    assert [end.senses for end in ends] == senses
    touching = any(senses)
    assert (len({end.run for end in ends}) == 1) == touching


def test_runs_in_any_order():
    """Two lines of four rods each: two runs, whatever the order."""
    rods = [rod(k, k + 1, across=x) for k in range(4) for x in (0.0, 1.0)]
    rng = np.random.default_rng(1)
    for _ in range(5):
        order = rng.permutation(8)
        ends = covered_ends([rods[k] for k in order], TOLERANCE)
        assert len({(order[i] % 2, end.run) for i, end in enumerate(ends)}) == 2
        assert sum(len(end.senses) for end in ends) == 12


def test_the_whole_of_a_run_and_what_is_covered():
    """Three rods of which one is turned: one rod from end to end, the same numbers for all; inner ends cover their sides."""
    ends = covered_ends([rod(1, 2, reverse=True), rod(0, 1), rod(2, 5)], TOLERANCE)
    (whole,) = {end.whole for end in ends}
    assert whole.half == pytest.approx(2.5, abs=1e-14)
    np.testing.assert_allclose(whole.centre, TURN @ [0.0, 0.0, 2.5], atol=1e-14)
    along = TURN[:, 2]
    assert [(end.cover(along), end.cover(-along), end.cover(TURN[:, 0])) for end in ends] == [
        (True, True, False),
        (True, False, False),
        (False, True, False),
    ]
