"""Validation cases: how numbers are compared, and that the page says what the engine computes."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from scipy.integrate import solve_ivp

from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.cli.main import main
from ffsm_mj.validation.case import (
    ComparedCase,
    ComparedNumber,
    Number,
    Origin,
    Topic,
    ValidationCase,
    Verdict,
    compared_case,
)
from ffsm_mj.validation.cases import CASES, case_names, detumbling, grasps, grips, impacts
from ffsm_mj.validation.page import committed_page, ours, stale_cases, stale_lines, total, validation_page

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=case_names())
def test_a_case_is_as_the_page_says(case):
    """Every number agrees or differs for a stated reason; the whole is what ``ffsm validate --check`` does."""
    compared = compared_case(case, case.compute())
    assert compared.verdict is not Verdict.DIFFERS
    assert stale_cases(committed_page(DOCS), [compared]) == []


def test_there_are_enough_cases_with_names_of_their_own():
    assert len(set(case_names())) == len(CASES)
    origins = Counter(case.origin for case in CASES)
    assert origins[Origin.PUBLISHED] >= 12
    assert origins[Origin.CLOSED_FORM] >= 8


@pytest.mark.parametrize(
    ("number", "value", "text"),
    [
        (Number("x", "", "1.23"), 1.23456, "1.235"),
        (Number("x", "", "1", 1e-12), 1.0 - 1e-15, "1.000000000000"),
        (Number("x", "", "0", 1e-3), -1e-9, "0.000"),
        (Number("x", "", "4.5e-14", at_most=True), 1.64e-14, "1.6e-14"),
        (Number("x", "", "4.5e-14", at_most=True), 1.64e-20, "< 1e-19"),
        (Number("x", "", "4.5e-14", at_most=True), 0.0, "0"),
    ],
)
def test_digits_are_those_of_the_tolerance(number, value, text):
    assert ours(ComparedNumber(number, value)) == text


def case(*values, known=""):
    """A compared case whose numbers are 1 to 1e-3."""
    numbers = tuple(Number(f"x{i}", f"x{i}, m", "1", 1e-3, known=known) for i in range(len(values)))
    stated = ValidationCase("name", "Title", Topic.IMPACTS, Origin.PUBLISHED, "Source", "Setting.", numbers, dict)
    return ComparedCase(stated, tuple(ComparedNumber(*each) for each in zip(numbers, values, strict=True)))


def test_a_case_is_as_bad_as_its_worst_number():
    assert case(1.0, 1.0).verdict is Verdict.AGREES
    assert case(1.0, 1.1).verdict is Verdict.DIFFERS
    assert case(1.0, 1.1, known="why").verdict is Verdict.EXPLAINED
    assert total([case(1.0, 1.1)]).endswith("2 numbers: 1 agree, 0 differ for a stated reason, 1 differ without one.")


def test_a_stale_page_is_noticed():
    page = validation_page([case(1.0, 1.0)])
    assert stale_cases(page, [case(1.0, 1.0)]) == []
    assert stale_cases(page, [case(1.0, 1.0004)]) == []
    assert stale_lines(page, validation_page([case(1.0, 1.0)])) == []
    assert len(stale_lines(page.replace("2 of 2 | agrees", "2 of 2 | differs"), page)) == 1
    (line,) = stale_cases(page, [case(1.0, 1.1, known="why")])[:1]
    assert line.startswith("name: line ")
    renamed = replace(case(1.0), case=replace(case(1.0).case, title="Other"))
    assert stale_cases(page, [renamed]) == ["name: no section 'Other'"]


def with_less(function, name):
    """The function with an argument a thousandth smaller."""
    return lambda *args, **kwargs: function(*args, **(kwargs | {name: 0.999 * kwargs[name]}))


@pytest.mark.long
@pytest.mark.parametrize(
    ("case", "module", "name", "wrong", "quantity"),
    [
        ("one-collision", impacts, "_off_centre", lambda hit: lambda e: hit(0.999 * e), "e = 0.5: energy ratio"),
        ("grip-shaken", grips, "_gripped", lambda grip: with_less(grip, "mu"), "both begin to slip, s"),
        ("grip-creep", grips, "_gripped", lambda grip: with_less(grip, "grip_N"), "1.01 of the limit"),
        (
            "mission-arm",
            grasps,
            "body",
            lambda text: lambda name, mass, *others, **more: text(name, 1.001 * mass, *others, **more),
            "base after, x, m/s",
        ),
        ("hinge-closes", grasps, "_grasped", lambda run: lambda pair, rates, *_: run(pair, rates, "ball"), "stopped"),
    ],
)
def test_a_wrong_input_differs(case, module, name, wrong, quantity, monkeypatch, capsys):
    """The engine is told something else than the source says: a number differs, and the command fails."""
    monkeypatch.setattr(module, name, wrong(getattr(module, name)))
    assert main(["validate", case]) == 1
    out = capsys.readouterr().out
    assert quantity in out
    assert "0 differ without one" not in out
    assert "differ without one" in out


def test_restitutions_of_spring_and_damper_are_those_of_their_motion():
    """M x'' = -k x - d x' from contact until the force is zero, integrated: the ratio of speeds, and the duration."""
    mass = detumbling._EFFECTIVE_KG
    for k, d in detumbling._CONTACTS:

        def force(_, x, k=k, d=d):
            return k * x[0] + d * x[1]

        def moves(t, x, force=force):
            return x[1], -force(t, x) / mass

        force.terminal = True
        found = solve_ivp(moves, (0.0, 1.0), (0.0, 1.0), events=force, rtol=1e-10, atol=1e-12)
        assert -found.y[1, -1] == pytest.approx(detumbling.restitution(k, d), abs=1e-8)
        assert found.t[-1] == pytest.approx(detumbling.contact_s(k, d), abs=1e-8)


@pytest.mark.parametrize("name", ["one-collision", "paper-baseline"])
def test_an_interrupted_case_has_no_numbers(name, monkeypatch, capsys):
    """Ctrl-C ends a run, which keeps what it has: that is no result."""
    monkeypatch.setattr(PreparedRun, "run", lambda _: SimpleNamespace(outcome="interrupted"))
    assert main(["validate", name]) == 130
    assert capsys.readouterr().out == ""


def test_one_case_on_the_command_line(capsys):
    assert main(["validate", "rod-with-friction"]) == 0
    out = capsys.readouterr().out
    assert "Stronge 1990" in out
    assert "\n1 case (0 with published numbers, 1 with closed forms)" in out
    assert out.rstrip().endswith("2 numbers: 2 agree, 0 differ for a stated reason, 0 differ without one.")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["one-colision"], "unknown case 'one-colision'"),
        (["one-collision", "--page"], "ffsm validate: --page writes the pages of all cases, or of seed-paper"),
        (["one-collision", "--check", "--long"], "ffsm validate: --long has no effect without seed-paper"),
        (["seed-paper", "--long"], "ffsm validate: --long has no effect without --check"),
        (["--page", "docs", "--check"], "ffsm validate: argument --check: not allowed with argument --page"),
        (["one-collision", "--check", "nowhere"], "nowhere/validation.md: cannot be read (No such file or directory)"),
    ],
)
def test_bad_input_is_one_line(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["validate", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(message)
    assert captured.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
