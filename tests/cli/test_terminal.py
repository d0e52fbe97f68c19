"""The commands on a terminal of their own: what is shown on the way, and that it is gone in the end."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest

from ffsm_mj.analysis.run import load_run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.cli.main import main
from ffsm_mj.report.run_report import run_report
from ffsm_mj.verification.truncation import ExplainedChecks
from tests.scenes import two_balls
from tests.terminal import ffsm, on_terminal

# A second or so of work: enough for the line, which waits 0.4 s, to be painted.
LONG_S = 60.0


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")


def squeezed(text: str) -> str:
    """Without blanks and line ends: a narrow terminal breaks lines anywhere."""
    return "".join(text.split())


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize(
    ("columns", "environment", "painted"),
    [
        (200, {}, "of 60 s"),
        (20, {}, " %  scene"),
        (80, {"NO_COLOR": "1"}, "of 60 s"),
        (80, {"TERM": "dumb"}, ""),
        (80, {"TERM": ""}, ""),
    ],
)
def test_a_run_shows_how_far_it_is_and_leaves_its_report_alone(tmp_path, monkeypatch, columns, environment, painted):
    path = str(two_balls(tmp_path, duration_s=LONG_S if painted else 0.1))
    run = ffsm("run", path, "--no-rerun", "--out", "a")
    shown = on_terminal(run, columns=columns, **environment)
    assert shown.code == 0, shown.written
    monkeypatch.setattr("ffsm_mj.report.terminal.terminal_width", lambda: columns if columns > 20 else None)
    read = load_run("a")
    expected = run_report(read, ExplainedChecks(all_checks(read)))
    called = "python -m ffsm_mj.cli.main"
    rest = f"files in a: mjcf, run.mcap, scenario.yaml, summary.json view: {called} view a verify: {called} analyze a"
    assert squeezed("".join(shown.screen)) == squeezed(expected + rest)
    assert shown.cursor
    if painted:
        assert painted in shown.written
    else:
        assert "\x1b" not in shown.written


@pytest.mark.long
@pytest.mark.parametrize("closed", ["2>&-", ">&-", "<&- >&- 2>&-"])
def test_closed_streams_end_nothing(tmp_path, closed):
    command = " ".join(ffsm("run", str(two_balls(tmp_path, duration_s=0.5)), "--no-rerun", "--out", "a"))
    process = subprocess.run(["sh", "-c", f"{command} {closed}"], capture_output=True, text=True, check=False)
    assert (process.returncode, process.stderr) == (0, "")
    assert load_run("a").outcome == "completed"


@pytest.fixture
def runs(tmp_path, capsys) -> tuple[str, str]:
    """Two runs, one a copy of the other."""
    assert main(["run", str(two_balls(tmp_path, duration_s=4)), "--no-rerun", "--out", "a"]) == 0
    shutil.copytree("a", "b")
    capsys.readouterr()
    return "a", "b"


@pytest.mark.long
def test_several_runs_are_analyzed_one_after_the_other(runs, capsys):
    """Each report is printed whole while the line is away; the same as without a terminal."""
    shown = on_terminal(ffsm("analyze", *runs, "--compare"))
    assert shown.code == 0, shown.written
    assert main(["analyze", *runs, "--compare"]) == 0
    assert squeezed("".join(shown.screen)) == squeezed(capsys.readouterr().out)
    assert shown.cursor


@pytest.mark.long
@pytest.mark.usefixtures("runs")
def test_figures_are_counted():
    shown = on_terminal(ffsm("analyze", "a", "--plots", "figures"))
    assert shown.code == 0, shown.written
    expected = "figures in figures: motion, base, torques, momenta, energies, conservation (svg, png)"
    assert squeezed("".join(shown.screen)).endswith(squeezed(expected))
    assert " of 6 figures" in shown.written
    assert "figures of a" not in "\n".join(shown.screen)


@pytest.mark.long
@pytest.mark.usefixtures("runs")
def test_pictures_of_a_film_are_counted():
    shown = on_terminal(ffsm("export", "a", "--gif", "--fps", "10"))
    assert shown.code == 0, shown.written
    assert shown.screen == ["a/motion.gif: 41 frames, 4.1 s in real time"]
    assert " of 41 pictures" in shown.written


@pytest.mark.long
def test_what_is_printed_goes_to_stdout_not_to_the_terminal_of_the_line(runs, tmp_path):
    """``ffsm analyze a b > file``: the line is on the terminal, the report in the file."""
    shown = on_terminal(ffsm("analyze", *runs), stdout=tmp_path / "report")
    assert (shown.code, shown.screen) == (0, [])
    assert (tmp_path / "report").read_text().endswith("2 of 2 runs verified\n")


VALIDATE = """
import sys, time
from ffsm_mj.cli import validate
from ffsm_mj.cli.main import main
from ffsm_mj.validation.cases.seed_paper.printed import PRINTED
from ffsm_mj.validation.cases.seed_paper.runs import SCENARIOS, Result

def perform(run):
    time.sleep(0.6 if run.threshold else 1.2 + 0.6 * SCENARIOS.index(run.scenario))  # none end together
    return Result({number.key: number.value for number in PRINTED})

validate.perform = perform
validate.paper.pages = lambda *_: {"reproduction.md": "1.2224\\n", "appendix-a.md": "A\\n"}
sys.exit(main(["validate", "seed-paper", "--check", sys.argv[1]]))
"""


@pytest.mark.long
@pytest.mark.parametrize("columns", [20, 200])
def test_validate_counts_its_runs(tmp_path, columns):
    """The whole command but for its runs, which only wait: known from the start how many, and each that ends is seen."""
    for name, text in (("reproduction.md", "1.2229\n"), ("appendix-a.md", "A\n")):
        (tmp_path / name).write_text(text)
    shown = on_terminal([sys.executable, "-c", VALIDATE, str(tmp_path)], columns=columns)
    assert shown.code == 1, shown.written
    assert "Traceback" not in shown.written
    assert squeezed("".join(shown.screen)).endswith("1linenotcurrent")
    assert "line1:committed'1.2229',now'1.2224'" in squeezed("".join(shown.screen))
    for done in range(5):
        assert (f"{done} of 5 cases" if columns == 200 else f"{100 * done / 5:.0f} %  validate") in shown.written


@pytest.mark.long
def test_an_interrupted_command_leaves_a_clean_terminal(tmp_path):
    """Ctrl-C in the middle: the log is kept, the line is gone, the cursor is back."""
    path = str(two_balls(tmp_path))
    command = ffsm("run", path, "-s", "duration_s=200", "--no-rerun", "--out", "a")
    shown = on_terminal(command, keys={"of 200 s": b"\x03"})
    assert shown.code == 130, shown.written
    assert shown.screen[-1] == "interrupted: the run was interrupted"
    assert "of 200 s" not in "\n".join(shown.screen)
    assert shown.cursor


SLOW = """
import sys, time
from ffsm_mj.assembly import models
from ffsm_mj.cli.main import main

compiled = models.compile_system
models.compile_system = lambda *args, **options: time.sleep(1.0) or compiled(*args, **options)
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize(
    "arguments",
    [
        ("check", "{}"),
        ("run", "{}", "--no-rerun", "--out", "a"),
        ("view", "{}", "--save", "a.rrd"),
        ("sensitivity", "{}", "--of", "impact_1.time_s", "--wrt", "initial.rates.robot/x=0.01"),
        ("fit", "none.csv", "--scenario", "{}"),
        ("impact-map", "{}"),
        ("fmu", "{}"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_command_that_compiles_for_a_second_shows_a_sign_of_life(tmp_path, arguments):
    """Whatever becomes of the command: the model of a real robot compiles for seconds before anything else is known."""
    path = str(two_balls(tmp_path, duration_s=0.1))
    shown = on_terminal([sys.executable, "-c", SLOW, *(argument.format(path) for argument in arguments)])
    assert "compile" in shown.written or "impact map" in shown.written, shown.written
    assert "compile" not in "\n".join(shown.screen)
    assert shown.cursor


NAMED = r"""
import time
from ffsm_mj.cli.standard_streams import progress

with progress() as shown:
    report = shown.stage("[red]a\x1b[31m\nb[/red]:smile:", "s", 30.0)
    report(12.3, 30.0)
    time.sleep(0.8)
"""


@pytest.mark.long
@pytest.mark.parametrize(("columns", "painted"), [(120, "12.3 of 30 s"), (40, "41 %  ")])
def test_names_of_files_neither_steer_the_terminal_nor_are_markup(columns, painted):
    shown = on_terminal([sys.executable, "-c", NAMED], columns=columns)
    assert (shown.code, shown.screen, shown.cursor) == (0, [], True)
    assert painted in shown.written
    assert r"[red]a\x1b[31m\nb[/red]:smile:" in shown.written
    assert "\x1b[31m" not in shown.written
