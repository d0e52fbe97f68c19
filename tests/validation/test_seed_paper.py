"""The seed paper: verdicts, pages that stay current, and the committed pages themselves."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ffsm_mj.cli import validate
from ffsm_mj.cli.main import main
from ffsm_mj.scenario.shipped import scenario_names
from ffsm_mj.validation.cases import seed_paper
from ffsm_mj.validation.cases.seed_paper import page as paper
from ffsm_mj.validation.cases.seed_paper.appendix import (
    PRINTED_TERMS,
    appendix_page,
    energy_terms,
    momentum_row,
    solve_printed,
)
from ffsm_mj.validation.cases.seed_paper.drift import drift, reach
from ffsm_mj.validation.cases.seed_paper.page import stated_inputs
from ffsm_mj.validation.cases.seed_paper.printed import PRINTED
from ffsm_mj.validation.cases.seed_paper.runs import SCENARIOS, THRESHOLD, Result, all_runs, measure, paper_run, slope
from ffsm_mj.validation.page import fixed, small, stale_lines

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "reproduction.md").read_text()


def row_of(printed):
    """The line of the page that tells of a printed number."""
    section = next(part for part in PAGE.split("\n## ") if part.startswith(printed.section))
    return next(line for line in section.splitlines() if line.startswith(f"| {printed.quantity} |"))


def test_printed_numbers_are_of_shipped_scenarios():
    assert {p.scenario for p in PRINTED} == set(SCENARIOS) <= set(scenario_names())


@pytest.mark.parametrize(
    ("old", "new", "stale"),
    [
        ("x | 1.2224 | agrees", "x | 1.2225 | agrees", False),
        ("x | 1.2224 | agrees", "x | 1.2226 | agrees", True),
        ("x | 1.2224 | agrees", "x | 1.2224 | differs", True),
        ("5e-5 + 1e-4", "5e-5 + 2e-4", False),
        ("5e-5 + 1e-4", "5e-5 + 1e-3", True),
        ("< 1e-9", "0.2", True),
        ("36 agree", "37 agree", True),
        ("Fig. 5a", "Fig. 5b", True),
    ],
)
def test_a_page_is_current_to_the_digits_it_gives(old, new, stale):
    assert bool(stale_lines(f"same\n{old}\n", f"same\n{new}\n")) == stale


def test_a_new_line_is_one_difference():
    assert stale_lines("a\nc 1\nd\n", "a\nb\nc 1\nd\n") == ["line 2: committed '', now 'b'"]


def test_numbers():
    assert [fixed(-0.00001, 3), fixed(2.5, 0), small(1e-12), small(-0.00753), small(-2.16, 2)] == [
        *("0.000", "2", "< 1e-9", "-0.008", "-2.2")
    ]


def test_coefficients_of_appendix_a(case_study, impact_state):
    """(36) within a unit of the second digit. 1.04 is printed as 1; the two rates in link 1's spin nearly cancel."""
    for ours, printed in zip(energy_terms(case_study, impact_state), PRINTED_TERMS, strict=True):
        assert ours.factor == pytest.approx(printed.factor, rel=0.05)
        for value, text in ((ours.slope, printed.slope), (ours.constant, printed.constant)):
            unit = 10.0 ** (math.floor(math.log10(abs(text))) - 1)
            assert abs(value - text) <= max(unit, 5e-5), ours.name
    row = momentum_row(case_study, impact_state)
    assert row == pytest.approx({"I_e,n": 0.316941, "x_o": -2.5, "y_o": -17.5, "psi_o": -0.8333}, abs=1e-6)
    energy = sum(t.factor * t.constant**2 for t in energy_terms(case_study, impact_state))
    assert energy == pytest.approx(0.28105, abs=1e-5)


def test_the_printed_equations_have_the_printed_solution():
    """Two digits in the coefficients leave about 1 % in the solution."""
    np.testing.assert_allclose(solve_printed(), (-1.2226, -0.2445, 0.2682), rtol=0.02)


def test_slope_turns_the_velocities_after(case_study, impact_state):
    after = impact_state.qvel[:6] + slope(case_study, impact_state) * -1.222381959
    expected = (0.135392276, -0.06405441, 0.025772885, 0.013376111, -0.105878565, 0.097889204)
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-8)


def test_the_scenarios_hold_what_the_paper_states():
    for name, printed, ours in stated_inputs():
        if not re.search("[A-Z]", printed):  # gains in words: "0.75 K_p", "I"
            assert printed == ours, name


def test_committed_appendix_is_current():
    assert stale_lines((DOCS / "appendix-a.md").read_text(), appendix_page()) == []


def test_every_printed_number_is_on_the_page():
    for printed in PRINTED:
        row = row_of(printed)
        assert printed.text in row
        if "**differs, explained**" in row:
            assert printed.known


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--check"],
            "docs/reproduction.md: cannot be read (No such file or directory); 'ffsm validate --page docs' writes it",
        ),
        (["--page", "file"], "file: cannot be used as a folder to write to (File exists)"),
        (["--page", "file/docs"], "file/docs: cannot be used as a folder to write to (Not a directory)"),
        (["--page", "x" * 300], f"{'x' * 300}: cannot be used as a folder to write to (File name too long)"),
    ],
)
def test_a_place_that_cannot_be_used_is_refused_before_the_runs(arguments, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    monkeypatch.setattr(validate, "_performed", lambda *_: pytest.fail("it ran"))
    assert main(["validate", "seed-paper", *arguments]) == 2
    assert capsys.readouterr().err.strip() == message


def as_committed():
    """Results that say what the page says: a number, or its difference where that is given to more digits."""
    values = {name: {} for name in SCENARIOS}
    declared = {}
    for printed in PRINTED:
        cells = [cell.strip() for cell in row_of(printed).strip("|").split("|")]
        ours, difference = cells[2], cells[-3]
        exact = printed.value + (0.0 if "<" in difference else float(difference))
        same = abs(exact - float(ours)) < 0.6 * 10.0 ** -len(ours.partition(".")[2])
        values[printed.scenario][printed.key] = exact if same else float(ours)
        declared |= {printed.key: float(cells[3])} if len(cells) == 7 and cells[3] else {}
    return {paper_run(name): Result(found) for name, found in values.items()} | {THRESHOLD: Result(declared)}


@pytest.fixture
def performed(monkeypatch):
    """The command does not run anything, but has the results of the committed page; the runs that it wanted."""
    wanted = []

    def performed(cases, runs, _):
        wanted.extend([*(case.name for case in cases), *runs])
        return as_committed()

    monkeypatch.setattr(validate, "_performed", performed)
    monkeypatch.setattr(paper, "appendix_page", (DOCS / "appendix-a.md").read_text)
    return wanted


def stale(committed, results):
    return stale_lines(committed, paper.pages(results, committed)[seed_paper.PAGE])


@pytest.mark.usefixtures("performed")
def test_the_page_is_current_when_each_scenario_says_so_once():
    """Differences and verdicts follow from our numbers; what only other runs tell is left as it stands."""
    assert stale(PAGE, as_committed()) == []
    results = as_committed()
    results[paper_run("baseline")].values["impulse"] += 0.01
    lines = stale(PAGE, results)
    assert len(lines) == 1
    assert "impulse" in lines[0]
    assert "**differs, explained**" in lines[0].partition("now")[2]


@pytest.mark.usefixtures("performed")
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("| mass of load, kg | 1 | 1 |", "| mass of load, kg | 1 | 2 |"),
        ("No tolerance is set to pass.", ""),
        ("| smallest tip error, m |", "| some tip error, m |"),
        ("0.005 + 0.002", "0.005 + 0.004"),
        ("with the arm straight, 4.41 m", "with the arm straight, 4.43 m"),
    ],
)
def test_a_page_that_was_changed_by_hand_is_stale(old, new):
    assert old in PAGE
    changed = PAGE.replace(old, new)
    assert stale(changed, as_committed())


def test_check_runs_each_scenario_once(performed, tmp_path, capsys):
    """The pages as committed are current; one changed number is named with its line, exit 1."""
    assert main(["validate", "seed-paper", "--check", str(DOCS)]) == 0
    assert capsys.readouterr().out.endswith(f"\n{DOCS}: current\n")
    assert performed == [*seed_paper.RUNS, THRESHOLD]
    for name in paper.PAGES:
        (tmp_path / name).write_text((DOCS / name).read_text())
    row = row_of(next(p for p in PRINTED if p.key == "impulse"))
    (tmp_path / seed_paper.PAGE).write_text(PAGE.replace(row, row.replace("1.222", "1.333", 1)))
    assert main(["validate", "seed-paper", "--check", str(tmp_path)]) == 1
    assert re.fullmatch(rf"{tmp_path}/reproduction.md: line \d+: committed .*1\.333.*\n", capsys.readouterr().err)


def test_pages_are_written_from_every_run(performed, tmp_path, capsys, monkeypatch):
    """``--page``, and ``--check --long``, which names what differs."""
    monkeypatch.setattr(paper, "pages", lambda *_: {"reproduction.md": "impulse 1.2224\n", "appendix-a.md": "A\n"})
    monkeypatch.setattr(paper, "save_figures", lambda folder, _: folder / "figures")
    arguments = ["validate", "seed-paper", "--check", str(tmp_path), "--long"]
    assert main(["validate", "seed-paper", "--page", str(tmp_path)]) == 0
    assert capsys.readouterr().out.endswith(f"written: {', '.join(f'{tmp_path}/{n}' for n in (*paper.PAGES, 'figures'))}\n")
    assert main(arguments) == 0
    assert performed == 2 * [*seed_paper.RUNS, *all_runs()]
    (tmp_path / "reproduction.md").write_text("impulse 1.2229\n")
    assert main(arguments) == 1
    expected = f"{tmp_path}/reproduction.md: line 1: committed 'impulse 1.2229', now 'impulse 1.2224'"
    assert capsys.readouterr().err.strip() == expected


def test_the_command_of_earlier_versions_names_the_present_one(capsys):
    assert main(["reproduce", "--check"]) == 2
    assert capsys.readouterr().err == "ffsm: unknown command 'reproduce'; use 'ffsm validate seed-paper'\n"


INTERRUPTED = """
import os, sys
from ffsm_mj.cli import validate
from ffsm_mj.cli.main import main
from ffsm_mj.validation.cases.seed_paper import runs
original = validate._perform

def perform(task):
    os.write(1, b"%d\\n" % os.getpid())  # one write: two workers begin at once
    return original(runs.LONG_RUNS["baseline, no thrusters"])

validate._perform = perform
perform.__module__, perform.__qualname__ = "ffsm_mj.cli.validate", "_perform"
sys.exit(main(["validate", "seed-paper", "--page", sys.argv[1]]))
"""


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_an_interrupted_page_leaves_no_worker_behind(tmp_path, number):
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    first = process.stdout.readline()
    process.send_signal(number)
    others, err = process.communicate(timeout=60)  # ends when no worker holds the pipe any more
    assert (process.returncode, err) == (130, "interrupted\n")
    for worker in (first + others).split():
        with pytest.raises(ProcessLookupError):
            os.kill(int(worker), 0)
    assert list(tmp_path.iterdir()) == []


def test_committed_page_tells_of_the_baseline(baseline, case_study):
    """The whole page is checked by ``ffsm validate --check`` in CI; here the baseline's column, from its log."""
    values = measure(baseline, case_study)
    for printed in PRINTED:
        if printed.scenario == "baseline":
            ours = row_of(printed).split("|")[3].strip()
            assert float(ours) == pytest.approx(values[printed.key], abs=10.0 ** -len(ours.partition(".")[2]))


def test_mass_centre_moves_at_p_over_m(baseline, case_study):
    """Whatever the arm does: RK4 leaves 4e-11 of momentum. No controller can do better than the bound."""
    seen = drift(baseline, case_study)
    assert seen.mass_kg == pytest.approx(12.0, abs=1e-8)
    assert seen.rate_m_s == pytest.approx(seen.momentum_N_s / seen.mass_kg, abs=1e-10)
    assert np.all(seen.error_m >= seen.bound_m)
    assert reach(case_study) == pytest.approx(4.41, abs=0.01)
    assert seen.lost_s == pytest.approx(22.6, abs=0.1)
    assert seen.bound_m[-1] > 0.7
