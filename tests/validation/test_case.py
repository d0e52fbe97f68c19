"""How a computed number stands to that of its source."""

from __future__ import annotations

import pytest

from ffsm_mj.validation.case import ComparedNumber, Number, Verdict, verdicts_in_words


@pytest.mark.parametrize(
    ("number", "value", "verdict"),
    [
        (Number("x", "", "1.23"), 1.2349, Verdict.AGREES),
        (Number("x", "", "1.23"), 1.2351, Verdict.DIFFERS),
        (Number("x", "", "-7.5e-3"), -7.54e-3, Verdict.AGREES),
        (Number("x", "", "-7.5e-3"), -7.56e-3, Verdict.DIFFERS),
        (Number("x", "", "-7.5e-3"), 7.5e-3, Verdict.DIFFERS),
        (Number("x", "", "1.23", known="why"), 1.2351, Verdict.EXPLAINED),
        (Number("x", "", "1.23", known="why"), 1.2349, Verdict.AGREES),
        (Number("x", "", "0.5", 1e-12), 0.5 + 2e-12, Verdict.DIFFERS),
        (Number("x", "", "1e-9", at_most=True), 1e-12, Verdict.AGREES),
        (Number("x", "", "1e-9", at_most=True), 1.1e-9, Verdict.DIFFERS),
        (Number("x", "", "6", approximate=True), 5.1, Verdict.AGREES),
        (Number("x", "", "6", approximate=True), 4.9, Verdict.DIFFERS),
        (Number("x", "", "1.23"), float("nan"), Verdict.DIFFERS),
        (Number("x", "", "1.23", known="why"), float("nan"), Verdict.DIFFERS),
        (Number("x", "", "1e-9", at_most=True, known="why"), float("-inf"), Verdict.DIFFERS),
        (Number("x", "", "1e-9", at_most=True), float("nan"), Verdict.DIFFERS),
    ],
)
def test_a_number_agrees_within_its_tolerance(number, value, verdict):
    assert ComparedNumber(number, value).verdict is verdict


@pytest.mark.parametrize(
    ("number", "ours", "verdict"),
    [
        (Number("x", "", "1.23", spread=0.0002), 1.2351, Verdict.AGREES),
        (Number("x", "", "2.3", at_most=True, spread=0.002), 2.301, Verdict.AGREES),
        (Number("x", "", "2.3", at_most=True, spread=0.002), 2.303, Verdict.DIFFERS),
        (Number("x", "", "1.23", spread=float("nan")), float("nan"), Verdict.DIFFERS),
    ],
)
def test_the_spread_of_ours_widens_the_tolerance(number, ours, verdict):
    assert ComparedNumber(number, ours).verdict is verdict


@pytest.mark.parametrize(
    ("quantity", "name"),
    [("speed, m/s", "speed"), ("impulse I_e,n, N s", "impulse I_e,n"), ("energy ratio", "energy ratio")],
)
def test_the_name_of_a_quantity_is_without_its_unit(quantity, name):
    assert Number("x", quantity, "1").name == name


def test_verdicts_in_words():
    numbers = [
        ComparedNumber(Number("x", "", "1", known=known), ours) for known, ours in (("", 1.0), ("why", 3.0), ("", 3.0))
    ]
    assert verdicts_in_words(numbers) == "3 numbers: 1 agree, 1 differ for a stated reason, 1 differ without one"
