"""Runs that wait for the clock: times by the clock, the same motion, overruns, and how they end."""

from __future__ import annotations

import fcntl
import os
import re
import signal
import time
from pathlib import Path
from threading import Timer

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.assembly.run import PACED_ROWS, simulate
from ffsm_mj.cli.main import main
from ffsm_mj.cli.progress import Progress
from ffsm_mj.errors import InputError
from ffsm_mj.log import background, recorder
from ffsm_mj.simulation.rows import RowWriter
from tests.contact_models.grasp.test_killed import killed
from tests.replays import assert_passes, assert_replayed
from tests.ticks import at_each_tick

TAP = {"duration_s": 0.6}
PACED = TAP | {"realtime.factor": 1.0}


def test_a_run_takes_its_time_and_is_the_same(tmp_path):
    """Bit for bit that of a run that does not wait, through impacts and contact; not faster than the clock.

    Each tick begins at its time or later, whatever else the machine does: its lateness is not negative, and the wall time
    of the run at least that of its last tick.
    """
    began = time.perf_counter()
    run = ffsm_mj.run("tap", TAP | {"realtime.factor": 2.0}, out=tmp_path / "run")
    took_s = time.perf_counter() - began
    free = ffsm_mj.run("tap", TAP)
    for key in free.keys:
        assert np.array_equal(run[key], free[key], equal_nan=True), key
    assert {*run.keys} - {*free.keys} == {f"clock.{name}" for name in ("late_s", "law_s", "busy_s", "overruns")}
    assert took_s > 0.3
    assert run["clock.late_s"].min() >= 0.0
    assert (np.diff(run["clock.overruns"]) >= 0.0).all()
    assert len(run.impacts) > 3
    assert_replayed(run)
    assert_passes(run)
    summary = ffsm_mj.summary(run)["realtime"]
    assert summary["ticks"] == len(run.time)
    assert summary["overruns"] == run["clock.overruns"][-1]
    assert summary["late_most_s"] == run["clock.late_s"].max()


@pytest.mark.parametrize("columns", [None, ("energy.total_J", "state.time_s")])
def test_a_run_in_memory_is_the_same(columns):
    """Its rows are completed when they are asked for."""
    run = simulate(prepare("tap", TAP | {"realtime.factor": 16.0}).assemble(), columns=columns)
    free = ffsm_mj.run("tap", TAP)
    assert len(run.keys) == (len(columns) if columns else len(free.keys) + 4)
    for key in columns or free.keys:
        assert np.array_equal(run[key], free[key], equal_nan=True), key


def test_steps_of_a_simulator_end_with_the_clock():
    """Steps to ticks, to events, and over many ticks; after a step back time goes on from there at once."""
    with ffsm_mj.Simulator("tap", TAP, realtime=4.0) as simulator:
        simulator.reset()
        began = time.perf_counter()
        simulator.step(until=0.2)
        assert time.perf_counter() - began >= 0.05 - 1e-4
        state = simulator.get_state()
        simulator.step(until="event")
        simulator.set_state(state)
        began = time.perf_counter()
        simulator.step(until=0.4)
        assert time.perf_counter() - began >= 0.05 - 1e-4


class Slow:
    """A law that takes its time at one tick."""

    telemetry_signals = ()

    def __init__(self, config, context):
        pass

    def start(self, observation):
        pass

    def control(self, observation, command):
        if 0.1 <= observation.time_s < 0.105:
            time.sleep(0.05)

    def telemetry(self):
        return ()


SLOW = {"phases": [{"name": "slow", "until": "end", "controller": {"kind": "slow"}}]}


def test_a_law_that_is_too_slow_is_an_overrun():
    """It sleeps over ten periods of 5 ms: the next tick is late by what is left, and time does not stretch.

    The last tick is due 0.6 s after the first, also after the pause: a machine that is not too busy makes up for it.
    """
    run = ffsm_mj.run("tap", PACED | SLOW, controllers={"slow": Slow})
    assert run["clock.law_s"][20] > 0.05
    assert run["clock.busy_s"][21] > 0.05
    assert run["clock.overruns"][21] >= run["clock.overruns"][20] + 1
    assert run["clock.late_s"][21] > 0.04


def test_a_bound_ends_the_run_and_its_log_is_whole(tmp_path):
    overrides = PACED | SLOW | {"realtime.max_late_s": 0.03}
    run = ffsm_mj.run("tap", overrides, controllers={"slow": Slow}, out=tmp_path / "run")
    assert run.outcome == "overrun"
    assert "s late; allowed are 0.03 s" in run.message
    assert run.complete
    assert run.time[-1] <= 0.11
    assert_replayed(ffsm_mj.load_run(tmp_path / "run"))


def test_a_log_that_cannot_be_written_ends_the_run(tmp_path, monkeypatch, processes):
    """What fails in the process of the log is raised in that of the run."""

    def full(_self, _block):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ffsm_mj.log.mcap.format.SampleCodec.encode", full)
    monkeypatch.setattr(background, "RECORDED_ROWS", 20)
    run = ffsm_mj.run("tap", PACED, out=tmp_path / "run", rerun=False)
    assert run.outcome == "write_failed"
    assert run.message == f"{tmp_path}/run/run.mcap.partial: No space left on device"
    assert_are_gone(processes)


@pytest.fixture
def processes(monkeypatch):
    """Processes of logs that are begun from here on."""
    begun, fork = [], os.fork

    def forked():
        process = fork()
        begun.append(process)
        return process

    monkeypatch.setattr(background.os, "fork", forked)
    return begun


def assert_are_gone(processes):
    assert processes
    for process in processes:
        with pytest.raises(ChildProcessError):
            os.waitpid(process, os.WNOHANG)


def flushed_often(patched):
    patched.setattr(recorder, "_FLUSH_PERIOD_S", 0.003)


def at(when_s, action):
    """What does something at the first tick from a time on."""
    done = []

    def act(time_s):
        if time_s >= when_s and not done:
            done.append(time_s)
            action()

    return act


@pytest.mark.skipif(not background.HAS_FORK, reason="the log is written in the process of the run")
def test_a_log_whose_process_is_killed_is_readable(tmp_path, monkeypatch, processes):
    """But for the rows of at most 0.2 s that the run has not sent yet; what it has sent is given time to be written."""

    def kill():
        time.sleep(0.5)
        os.kill(processes[0], signal.SIGKILL)

    with monkeypatch.context() as patched:
        flushed_often(patched)
        at_each_tick(patched, at(0.5, kill))
        run = ffsm_mj.run("tap", PACED, out=tmp_path / "run", rerun=False)
    assert run.outcome == "write_failed"
    assert run.message == f"{tmp_path}/run/run.mcap.partial: the process that wrote it is gone"
    assert_are_gone(processes)
    read = ffsm_mj.load_run(tmp_path / "run")
    assert 0.2 < read.time[-1] <= 0.5
    assert len(read.impacts) > 1
    assert_replayed(read)


@pytest.mark.skipif(not background.HAS_FORK, reason="the log is written in the process of the run")
def test_a_run_waits_for_a_log_that_is_far_behind(tmp_path, monkeypatch, processes):
    """Its process is stopped for 0.3 s, in which there would be 60 rows, with room for 40: none is lost."""
    monkeypatch.setattr(background, "_SHARED_ROWS", 2 * PACED_ROWS)

    def stop():
        os.kill(processes[0], signal.SIGSTOP)
        Timer(0.3, os.kill, (processes[0], signal.SIGCONT)).start()

    with monkeypatch.context() as patched:
        at_each_tick(patched, at(0.1, stop))
        run = ffsm_mj.run("coasting", PACED | {"control_period_s": 0.005}, out=tmp_path / "run", rerun=False)
    assert run.outcome == "completed", run.message
    assert run["clock.late_s"].max() > 0.05
    assert len(run.time) == 121
    assert_replayed(ffsm_mj.load_run(tmp_path / "run"))


@pytest.mark.skipif(not background.HAS_FORK, reason="the log is written in the process of the run")
def test_a_run_does_not_wait_for_a_log_whose_process_is_killed(tmp_path, monkeypatch, processes):
    """Neither events nor the time show it before there is no room for more rows."""
    monkeypatch.setattr(background, "_SHARED_ROWS", 2 * PACED_ROWS)
    with monkeypatch.context() as patched:
        at_each_tick(patched, at(0.1, lambda: os.kill(processes[0], signal.SIGKILL)))
        run = ffsm_mj.run("coasting", PACED | {"control_period_s": 0.005}, out=tmp_path / "run", rerun=False)
    assert (run.outcome, run.message) == (
        "write_failed",
        f"{tmp_path}/run/run.mcap.partial: the process that wrote it is gone",
    )
    assert run.log.outcome.end_s < 0.5


def test_shared_rows_come_in_order(rng, monkeypatch):
    """Of a ring of 50 rows, blocks of up to 30 at a time: none is lost or written over, whatever is taken when."""
    monkeypatch.setattr(background, "_SHARED_ROWS", 50)
    shared, written, taken, refused = background._SharedRows(2), 0, [], 0
    while written < 1000:
        block = np.arange(written, written + rng.integers(1, 31), dtype=float)[:, None] * [1.0, 2.0]
        has_room = written + len(block) - sum(map(len, taken)) <= 50
        assert shared.write(block) == has_room
        written, refused = written + has_room * len(block), refused + (not has_room)
        assert shared.written == written
        if not has_room or rng.random() < 0.5:
            taken.append(shared.take(written - rng.integers(0, 5)))
    taken.append(shared.take(written))
    np.testing.assert_array_equal(np.concatenate(taken), np.arange(written)[:, None] * [1.0, 2.0])
    assert refused > 10


@pytest.mark.skipif(not background.HAS_FORK, reason="the log is written in the process of the run")
def test_a_run_that_is_killed_leaves_a_readable_log(tmp_path, monkeypatch):
    """And no process: its lock on the log is free."""
    with monkeypatch.context() as patched:
        flushed_often(patched)
        at_each_tick(patched, at(0.5, lambda: os.kill(os.getpid(), signal.SIGKILL)))
        killed("tap", tmp_path / "run", PACED)
    with (tmp_path / "run" / "run.mcap.partial").open("r+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # waits for what the process of the log still writes
    read = ffsm_mj.load_run(tmp_path / "run")
    assert read.outcome == "incomplete"
    assert 0.2 < read.time[-1] <= 0.5
    assert_replayed(read)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_reaches_both_processes_and_the_log_is_whole(tmp_path, monkeypatch, processes, number):
    """A terminal sends it to all of its processes, and the log must not end before the run does."""

    def interrupt():
        for process in (*processes, os.getpid()):
            os.kill(process, number)

    with monkeypatch.context() as patched:
        at_each_tick(patched, at(0.4, interrupt))
        with pytest.raises(KeyboardInterrupt):
            ffsm_mj.run("tap", PACED, out=tmp_path / "run", rerun=False)
    assert_are_gone(processes)
    read = ffsm_mj.load_run(tmp_path / "run")
    assert (read.outcome, read.complete) == ("interrupted", True)
    assert read.time[-1] == pytest.approx(0.4, abs=1e-9)
    assert_replayed(read)


class Failing(Slow):
    """A law with a mistake that shows late."""

    def control(self, observation, command):
        assert observation.time_s < 0.3, "too late"


def test_the_log_of_a_law_that_fails_is_whole(tmp_path, processes):
    overrides = PACED | {"phases": [{"name": "late", "until": "end", "controller": {"kind": "failing"}}]}
    with pytest.raises(AssertionError, match="too late"):
        ffsm_mj.run("tap", overrides, controllers={"failing": Failing}, out=tmp_path / "run", rerun=False)
    assert_are_gone(processes)
    read = ffsm_mj.load_run(tmp_path / "run")
    assert (read.outcome, read.complete) == ("controller_failed", True)
    assert_replayed(read)


@pytest.mark.parametrize("factor", [0.0, -1.0, float("inf"), float("nan")])
def test_a_pace_that_is_none_is_refused(factor):
    with pytest.raises(InputError, match=r"realtime\.factor"):
        ffsm_mj.Simulator("tap", realtime=factor)


@pytest.mark.parametrize("has_fork", [background.HAS_FORK, False], ids=["process", "thread"])
def test_the_log_is_that_of_a_run_that_writes_itself(tmp_path, monkeypatch, has_fork):
    """Rows, events and their order, and what is computed of them: written by another process, and at once."""
    monkeypatch.setattr(background, "HAS_FORK", has_fork)
    paced = ffsm_mj.run("tap", TAP | {"realtime.factor": 8.0}, out=tmp_path / "paced", rerun=False)
    free = ffsm_mj.run("tap", TAP, out=tmp_path / "free", rerun=False)
    read, other = (ffsm_mj.load_run(Path(run.path)) for run in (paced, free))
    assert len(read.impacts) > 3
    assert list(map(str, read.log.events)) == list(map(str, other.log.events))
    for key in free.keys:
        assert np.array_equal(read[key], other[key], equal_nan=True), key
    summaries = [ffsm_mj.summary(run) for run in (paced, free)]
    for name in ("effort", "base_rotation", "angular_momentum", "impacts", "contacts", "conservation"):
        assert summaries[0][name] == summaries[1][name], name


def test_the_command_says_when_a_run_ends_and_draws_no_line(tmp_path, monkeypatch, capsys):
    """A line that is drawn ten times a second by a thread would take the interpreter from ticks."""
    begun, stage = [], Progress.stage
    monkeypatch.setattr(Progress, "stage", lambda self, *args: begun.append(args) or stage(self, *args))
    options = ["--realtime", "20", "--no-rerun", "--out", str(tmp_path / "run")]
    assert main(["run", "tap", "-s", "duration_s=0.2", *options]) == 0
    assert begun == [("compile tap",)]
    assert re.search(r"^tap: 0\.01 s by the clock, until \d\d:\d\d:\d\d$", capsys.readouterr().err, re.MULTILINE)


@pytest.mark.skipif(not background.HAS_FORK, reason="the log is written in the process of the run")
def test_what_a_tick_does_for_the_log_is_bounded(tmp_path, monkeypatch):
    """It sends some rows as they are; what is computed of them is done in the process of the log. All of them arrive."""
    of_run, sent = os.getpid(), []
    complete, rows = RowWriter.complete, background.BackgroundSink.rows

    def elsewhere(writer, block):
        assert os.getpid() != of_run
        return complete(writer, block)

    def counted(sink, block):
        sent.append(len(block))
        rows(sink, block)

    monkeypatch.setattr(RowWriter, "complete", elsewhere)
    monkeypatch.setattr(background.BackgroundSink, "rows", counted)
    run = ffsm_mj.run("tap", PACED, out=tmp_path / "run", rerun=False)
    assert run.outcome == "completed", run.message
    assert sum(sent) == len(run.time) == 121
    assert max(sent) == PACED_ROWS
    assert_passes(run)
