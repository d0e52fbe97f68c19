"""An exception of ours inside a run is an outcome of its own: the log is whole, tells it, and can be analyzed."""

from __future__ import annotations

import json
from itertools import count

import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.balance.balance import Balance
from ffsm_mj.cli.main import main
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.contact_models.grasp.load import LoadSampler
from ffsm_mj.contact_models.grasp.model import GraspModel
from ffsm_mj.contact_models.impact.model import ImpactModel
from ffsm_mj.contact_models.persistent.closed_contacts import ClosedContacts
from ffsm_mj.contact_models.persistent.columns import ContactReport
from ffsm_mj.log.mcap.sink import McapSink
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.replay import replay_log
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from ffsm_mj.simulation.rows import RowWriter
from tests.contact_models.grasp.test_closing import pushing
from tests.scenes import two_balls
from tests.ticks import in_the_loop

PLACES = {
    "a contact model, in a stage": (ClosedContacts, "push", 3),
    "a contact model, at its event": (GraspModel, "act", 0),
    "a contact model, told of an event": (GraspModel, "after_event", 1),
    "an impact": (ImpactModel, "resolve", 0),
    "records of an event": (ContactReport, "records", 0),
    "the integrator": (EventDrivenIntegrator, "advance", 50),
    "the balance": (Balance, "close", 40),
    "the balance, at an event": (Balance, "enter", 3),
    "the start of a step": (EventDrivenIntegrator, "_begin_step", 30),
    "a row": (RowWriter, "fill", 30),
    "a part of a row": (LoadSampler, "take", 30),
    "a block of rows": (RowWriter, "complete", 3),
    "the recorder": (Recorder, "commit", 20),
    "the log": (McapSink, "rows", 2),
    "the log, an event": (McapSink, "event", 2),
    "the end, overlaps": (ContactWatch, "finish", 1),  # once for the notes before the run
    "the end, grasps": (GraspModel, "finish", 0),
}


def breaks(monkeypatch, owner, method, after):
    """A method raises once it was called so many times; a thing that is broken stays so."""
    in_the_loop(monkeypatch)
    calls, whole = count(), getattr(owner, method)

    def broken(*arguments, **named):
        if next(calls) >= after:
            raise ZeroDivisionError("on\npurpose")
        return whole(*arguments, **named)

    monkeypatch.setattr(owner, method, broken)


@pytest.mark.long
@pytest.mark.parametrize("place", PLACES)
def test_the_log_is_whole_and_tells_it(tmp_path, monkeypatch, capsys, place):
    """Exit code 3, one line, a finished log with the traceback, a summary; what was logged before still verifies."""
    path, out = pushing(tmp_path / "scene", {"position_m": 0.1185}), tmp_path / "out"
    with monkeypatch.context() as patched:
        breaks(patched, *PLACES[place])
        assert main(["run", str(path), "--out", str(out), "--no-rerun"]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("internal_error: at t = ")
    assert "ZeroDivisionError: on purpose" in line
    assert (out / "run.mcap").is_file()
    assert not (out / "run.mcap.partial").exists()
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["outcome"], f"internal_error: {summary['message']}") == ("internal_error", line)
    run = ffsm_mj.load_run(out)
    assert (run.outcome, run.complete) == ("internal_error", True)
    lost = place == "a block of rows"  # those of the block; all others lose none
    assert run.damage.startswith("samples are missing from 0.03 to ") == lost
    assert lost or not run.damage
    again = replay_log(run.log)
    assert again.agrees, again.worst
    assert [check for check in again.checks() if not check.passes] == []
    if place != "the log, an event":  # which takes no record any more
        (record,) = run.records["internal_errors"]
        assert record.traceback.startswith("Traceback")
        assert record.traceback.endswith("ZeroDivisionError: on\npurpose\n")
        assert str(ffsm_mj.__path__[0]) not in record.traceback


def test_analyze_says_it_and_shows_the_traceback(tmp_path, monkeypatch, capsys):
    path, out = two_balls(tmp_path), tmp_path / "out"
    with monkeypatch.context() as patched:
        breaks(patched, Balance, "close", 40)
        ffsm_mj.run(path, out=out, rerun=False, check=False)
    assert main(["analyze", str(out)]) == 0
    told = capsys.readouterr().out
    assert "internal_error (at t = 0.04 s: ZeroDivisionError: on purpose" in told
    assert f"traceback: ffsm analyze {out} --traceback" in told
    assert main(["analyze", str(out), "--traceback"]) == 0
    assert 'File "ffsm_mj/simulation/loop.py", line' in capsys.readouterr().out


def test_an_exception_of_the_caller_is_the_callers(tmp_path):
    """What ``report`` raises is not the run's: it ends the call."""

    def report(time_s, _):
        if time_s > 0.1:
            raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        prepare(two_balls(tmp_path)).run(report=report)


def test_a_failing_command_does_not_claim_that_a_check_fails(monkeypatch, capsys):
    """Exit code 1 is a failed check; Python's own for an exception is the same."""
    monkeypatch.setattr("ffsm_mj.cli.check.scenario_schema", lambda: {}[1])
    assert main(["schema"]) == 3
    line = test_a_failing_command_does_not_claim_that_a_check_fails.__code__.co_firstlineno + 2
    told = f"internal_error: KeyError: 1 (test_internal_errors.py:{line}); FFSM_TRACEBACK=1 shows the traceback\n"
    assert capsys.readouterr().err == told


def test_errors_are_raised_again_in_python(tmp_path, monkeypatch):
    """With the frames of the code that raised; the log is complete as without."""
    breaks(monkeypatch, *PLACES["the integrator"])
    with pytest.raises(ZeroDivisionError, match="purpose") as caught:
        ffsm_mj.run(two_balls(tmp_path), out=tmp_path / "a")
    assert caught.traceback[-1].name == "broken"
    assert ffsm_mj.load_run(tmp_path / "a").outcome == "internal_error"
