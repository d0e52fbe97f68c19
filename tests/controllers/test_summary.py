"""What control laws say of their work at the end of a run: per phase, the same from memory and from the log."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

import ffsm_mj
from ffsm_controllers import kinds
from ffsm_controllers.endings import Ending, TimeTrigger
from ffsm_controllers.off import Off
from ffsm_controllers.phases import Phase, PhaseMachine
from ffsm_mj.analysis.run import Run
from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.errors import ControllerError
from ffsm_mj.log.mcap.format import decode_record, encode_record
from ffsm_mj.records.events import OUTCOME, OutcomeRecord
from tests.scenes import two_balls


class Told:
    """A law that says what it is given."""

    telemetry_signals: ClassVar = ()

    def __init__(self, **told):
        self.told = told

    def start(self, observation): ...

    def control(self, observation, command): ...

    def telemetry(self):
        return ()

    def summary(self):
        return self.told


@pytest.fixture
def telling(monkeypatch, tmp_path):
    """A scene whose one phase says what is given here."""

    def ready(told):
        law = type("Telling", (Off,), {"summary": told})
        monkeypatch.setitem(kinds().classes, "off", law)
        return two_balls(tmp_path, duration_s=0.01)

    return ready


def test_a_phase_machine_asks_the_laws_of_the_phases_begun():
    one, two, three = Told(count=np.int64(3), error_m=np.float32(0.5), note="near"), Off(None, None), Told(never=1)
    machine = PhaseMachine(
        [
            Phase("a", "x", one, (Ending("time", TimeTrigger(1.0)),)),
            Phase("b", "off", two, (Ending("time", TimeTrigger(1.0)),)),
            Phase("c", "x", three),
        ]
    )
    assert machine.reports() == {}
    for time in (0.0, 0.5, 1.0):
        machine.control(Observation(time, None), Command.off(0))
    reports = machine.reports()
    assert reports == {"a": {"count": 3, "error_m": 0.5, "note": "near"}, "b": {}}
    assert [type(value) for value in reports["a"].values()] == [int, float, str]  # Python's own, which JSON takes


@pytest.mark.parametrize("value", [np.nan, np.inf, None, [1.0], 1j, np.bool_(True)])
def test_what_is_no_finite_number_or_text_is_refused_by_name(value):
    machine = PhaseMachine([Phase("a", "x", Told(good=1, bad=value))])
    machine.control(Observation(0.0, None), Command.off(0))
    with pytest.raises(ControllerError, match=r"summary of phase 'a' \(x\): bad is .*, no finite number or text"):
        machine.reports()


def test_memory_log_and_file_say_the_same(telling, tmp_path):
    told = {"count": 2**60, "error_m": 0.1, "note": 'ä "quoted"\n'}
    kept = ffsm_mj.run(telling(lambda _: told))
    written = ffsm_mj.run(telling(lambda _: told), out=tmp_path / "out", rerun=False)
    read = ffsm_mj.load_run(tmp_path / "out")
    file = json.loads((tmp_path / "out" / "summary.json").read_text())
    (phase,) = kept.phases
    expected = {"ticks": 10, "phases": [{"name": phase.name, "kind": "off", "reports": told}]}
    for summary in (kept.summary(), written.summary(), read.summary(), file):
        assert summary["controller"] == expected
    assert read.log.outcome.reports == kept.log.outcome.reports == {phase.name: told}


def test_a_log_that_breaks_off_reports_nothing(telling):
    whole = ffsm_mj.run(telling(lambda _: {"count": 1}))
    (phase,) = Run(replace(whole.log, outcome=None)).summary()["controller"]["phases"]
    assert phase["reports"] == {}


def test_a_law_that_cannot_say_it_has_failed_and_the_log_is_kept(telling, tmp_path):
    run = ffsm_mj.run(telling(lambda _: {"rate": 1.0 / 0.0}), out=tmp_path / "out", rerun=False, check=False)
    assert run.outcome == "controller_failed"
    assert run.message.startswith("phase ")
    assert "at its end: ZeroDivisionError: " in run.message
    assert run.message.splitlines() == [run.message]
    assert len(ffsm_mj.load_run(tmp_path / "out").time) == 11


@pytest.mark.parametrize("report", ["", "1", "[1]", '{"a": [1]}', '{"a": NaN}', '{"a": null}', "[" * 100_000])
def test_a_report_of_somebody_else_is_checked_where_it_is_read(report):
    outcome = OutcomeRecord("completed", "", 1.0, 1, 0.0, 1, {"phase": {"count": 12345}})
    assert decode_record(OUTCOME, encode_record(outcome)) == outcome
    with pytest.raises(ValueError, match=r"report|Expecting"):
        decode_record(OUTCOME, encode_record(replace(outcome, reports={"phase": report})))
