"""The commands on a terminal of their own: what is shown on the way, and that it is gone in the end."""

from __future__ import annotations

import subprocess

import pytest

from ffsm_mj.analysis import load_run
from ffsm_mj.text_report import run_report
from tests.scenes import two_balls
from tests.terminal import ffsm, on_terminal

# Three seconds or so of work: enough for the line, which waits 0.4 s, to be painted.
LONG = ("-s", "duration_s=20", "--no-rerun")


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")


def squeezed(text: str) -> str:
    """Without blanks and line ends: a narrow terminal breaks lines anywhere."""
    return "".join(text.split())


@pytest.mark.parametrize(
    ("columns", "environment", "painted"),
    [
        (200, {}, "of 20 s"),
        (20, {}, " %  scene"),
        (80, {"NO_COLOR": "1"}, "of 20 s"),
        (80, {"TERM": "dumb"}, ""),
        (80, {"TERM": ""}, ""),
    ],
)
def test_a_run_shows_how_far_it_is_and_leaves_its_report_alone(tmp_path, columns, environment, painted):
    shown = on_terminal(ffsm("run", str(two_balls(tmp_path)), *LONG, "--out", "a"), columns=columns, **environment)
    assert shown.code == 0, shown.written
    expected = run_report(load_run("a"))
    rest = "files in a: mjcf, run.mcap, scenario.yaml, summary.json look at it: ffsm view a verify the log: ffsm analyze a"
    assert squeezed("".join(shown.screen)) == squeezed(expected + rest)
    assert shown.cursor
    if painted:
        assert painted in shown.written
    else:
        assert "\x1b" not in shown.written


@pytest.mark.parametrize("closed", ["2>&-", ">&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams_end_nothing(tmp_path, closed):
    command = " ".join(ffsm("run", str(two_balls(tmp_path)), "--no-rerun", "--out", "a"))
    process = subprocess.run(["sh", "-c", f"{command} {closed}"], capture_output=True, text=True, check=False)
    assert (process.returncode, process.stderr) == (0, "")
    assert load_run("a").outcome == "completed"
