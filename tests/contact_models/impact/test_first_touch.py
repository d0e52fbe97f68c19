"""First touch of one pair, for gaps that are known functions of time."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.time_of_impact import first_touch

ROUNDING = 1e-14


def path(gap, slope):
    """A pair whose gap is a polynomial of time, and the times at which it was evaluated."""
    looked = []

    def at(time):
        looked.append(time)
        normal = np.array([1.0, 0.0, 0.0])
        rates = np.array([float(slope(time))])
        return Proximity(float(gap(time)), normal, np.zeros((1, 3)), rates, rate_tolerance=1e-12, rounding=ROUNDING)

    return at, looked


def touch(coefficients, *, pressed=False, span=(0.0, 1.0)):
    """First touch for the polynomial with these coefficients, highest power first."""
    gap = np.poly1d(coefficients)
    at, looked = path(gap, gap.deriv())
    found = first_touch(at, *span, lambda _: pressed)
    assert len(looked) < 250
    return found


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ([-1.0, 0.25], 0.25),  # straight in
        ([1.0, 0.25], None),  # straight out
        ([4.0, -4.0, 0.99], 0.45),  # a dip: (2 t - 1)^2 - 0.01, on the way down
        ([4.0, -4.0, 1.01], None),  # a graze that does not touch
        ([-1.0, 0.5, 0.0], 0.5),  # leaves a contact and comes back
        ([-1.0, 0.5, 1e-16], 0.5),  # the same from a gap at rounding level, not at its own start
        ([-1.0, 0.5, -1e-15], 0.5),  # and from below: back at the gap that it left
        ([-1.0, 0.0], 0.0),  # closed and approaching: at once
        ([1.0, 0.0], None),  # closed and leaving
        ([0.0], None),  # closed and still
        ([-1e-13, 0.0, 0.0], None),  # fallen by less than a hundred times rounding: still
    ],
)
def test_first_touch(coefficients, expected):
    """The root is accurate to the rounding of the gap over its slope there, which is at least 0.1."""
    found = touch(coefficients)
    assert found is None if expected is None else found == pytest.approx(expected, abs=10.0 * ROUNDING + 1e-13)


def test_pressed_from_rest_and_not():
    """Closed, at rest and falling: at once if it is pressed, else when it has fallen by a hundred times the rounding."""
    assert touch([-1.0, 0.0, 0.0], pressed=True) == 0.0
    assert touch([-1.0, 0.0, 0.0]) == pytest.approx(np.sqrt(100.0 * ROUNDING), rel=0.01)


def test_two_extrema_are_bisected():
    """A closed pair rises, falls below, and rises again: 20 t^3 - 27 t^2 + 8 t touches first at 0.4393 s."""
    first = (27.0 - np.sqrt(27.0**2 - 4.0 * 20.0 * 8.0)) / 40.0
    gap = np.poly1d([20.0, -27.0, 8.0, 0.0])
    end = 0.85  # still below, rising already
    assert gap(end) < 0.0 < gap.deriv()(end)
    assert touch(gap.coefficients, span=(0.0, end)) == pytest.approx(first, abs=1e-13)


@pytest.mark.parametrize(
    ("gap", "rate", "approaches"),
    [(0.0, -1e-11, True), (0.0, -1e-13, False), (0.0, 1e-11, False), (-1e-10, -1e-13, True), (-1e-10, -1e-16, False)],
)
def test_a_slow_approach_counts_in_penetration(gap, rate, approaches):
    """5e-13 m/s is rounding in contact, but would be an overlap of 1e-9 m after half an hour."""
    near = Proximity(
        gap, np.array([1.0, 0.0, 0.0]), np.zeros((1, 3)), np.array([rate]), rate_tolerance=1e-12, rounding=ROUNDING
    )
    assert near.approaches == approaches


@pytest.mark.parametrize("level", [0.0, 3e-13])
def test_a_gap_that_stays_at_rounding_and_then_falls_at_once(level):
    """The gap of a cap that falls flat has a kink: regula falsi alone stops 1e-7 s past it after all its iterations."""
    kink, speed = 7.5e-5, 0.27
    at, looked = path(lambda t: min(level, level - speed * (t - kink)), lambda t: 0.0 if t < kink else -speed)
    found = first_touch(at, 0.0, 5e-4, lambda _: False)
    assert found == pytest.approx(kink + level / speed, abs=1e-11)
    assert len(looked) < 250


def test_a_fall_within_an_instant_of_the_start_is_rounding():
    """From 0 s on halves never end: a thousand lead to the least number."""
    at, looked = path(lambda time: -1e-9 if time > 0.0 else 0.0, lambda _: 1.0)
    assert first_touch(at, 0.0, 1e-3, lambda _: False) is None
    assert len(looked) < 250


def test_a_pair_apart_by_rounding_that_ends_in_contact_by_rounding_does_not_touch():
    """It must fall by more than rounding to touch again, whether it starts closed or apart by less than that."""
    assert touch([-1.7e-14, 1e-14, 5e-15]) is None
    assert touch([-1.7e-14, 1e-14, 0.0]) is None
