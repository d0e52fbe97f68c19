"""Events at one instant are put in the order in which each begins where the one before it ends."""

from __future__ import annotations

from ffsm_mj.records.event_order import merged


def jump(event, after):
    return abs(after[0] - event[1])


def test_an_impact_precedes_two_captures_whatever_they_do_to_the_state():
    """The second capture ends near where the impact began: compared one by one it would come before."""
    impact, first, second = (0.0, 1.0), (1.0, 10.0), (10.0, 0.5)
    assert merged([impact], [first, second], jump) == [impact, first, second]


def test_an_impact_between_two_captures():
    impact, first, second = (10.0, 0.5), (0.0, 10.0 + 1e-12), (0.5, 3.0)
    assert merged([impact], [first, second], jump) == [first, impact, second]
