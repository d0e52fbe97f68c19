"""What belongs to the whole process is the user's: a run leaves it as it was, whatever runs beside it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from threading import Barrier, Event, Thread, current_thread

import mujoco
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.assembly.process import noted, one_blas_thread
from ffsm_mj.model import composition
from ffsm_mj.model.mujoco_process import stopped_clock
from ffsm_mj.replay import replay_log
from tests.scenes import two_balls


def blas():
    """Threads of each BLAS that is loaded."""
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.fixture
def two():
    """BLAS with two threads, as on a user's machine; the suite has it set to one.

    Set in a thread that ends: threadpoolctl lets nobody else change what a thread has set while that lives.
    """
    elsewhere(threadpool_limits, 2, "blas")
    assert blas() == {2}
    yield
    elsewhere(threadpool_limits, 1, "blas")


def elsewhere(function, *arguments):
    """Call in a thread of its own, to its end."""
    thread = Thread(target=function, args=arguments)
    thread.start()
    thread.join()


@pytest.mark.long
def test_a_run_with_everything_leaves_the_process_as_it_was(tmp_path):
    """Environment, signals, warnings, numpy's errors and BLAS, in a process of its own that has imported nothing before."""
    code = """
import os, signal, sys, warnings
os.environ.pop("OPENBLAS_NUM_THREADS", None), os.environ.pop("RUST_LOG", None)
import numpy as np
import ruamel.yaml  # which adds to the filters of warnings
from threadpoolctl import threadpool_info

def state():
    threads = [library["num_threads"] for library in threadpool_info()]
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    return dict(os.environ), handlers, list(warnings.filters), np.geterr(), threads

before = state()
import ffsm_mj
run = ffsm_mj.run(sys.argv[1], {"duration_s": 0.35}, out=sys.argv[2], rerun=True)
from ffsm_mj.log.rerun.viewer import LiveSink
assert len(run.impacts) == 1 and all(check.passes for check in run.checks())
for then, now in zip(before, state()):
    assert then == now, (then, now)
import mujoco
assert mujoco.get_mju_user_warning() is None
"""
    command = [sys.executable, "-c", code, str(two_balls(tmp_path)), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "out" / "run.rrd").is_file()


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("level", [None, "off"])
def test_rerun_logs_as_the_user_says_or_as_the_run_does(level):
    """Its SDK reads RUST_LOG at its import: at ``trace`` it would say a lot."""
    code = """
import os, sys
from ffsm_mj.log.rerun.viewer import rust_log
stated = os.environ.get("RUST_LOG")
with rust_log("trace"):
    import rerun as rr
assert os.environ.get("RUST_LOG") == stated
stream = rr.RecordingStream("x")
stream.memory_recording()
stream.log("a", rr.Scalars(1.0))
stream.flush()
"""
    environment = {name: os.environ[name] for name in ("PYTHONPYCACHEPREFIX",) if name in os.environ}
    environment |= {} if level is None else {"RUST_LOG": level}
    command = [sys.executable, "-c", code]
    said = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stderr
    assert bool(said) == (level is None)


@pytest.mark.usefixtures("two")
def test_blas_has_one_thread_in_a_run_and_what_it_had_afterwards(tmp_path):
    inside = []
    run = ffsm_mj.run(two_balls(tmp_path, duration_s=0.01), report=lambda *_: inside.append(blas()))
    assert set().union(*inside) == {1}
    assert blas() == {2}
    replay_log(run.log, report=lambda *_: inside.append(blas()))
    assert set().union(*inside) == {1}
    assert blas() == {2}


def timed(data, model):
    """Whether MuJoCo times a step."""
    data.timer.duration[:] = 0.0
    mujoco.mj_step(model, data)
    return bool(np.any(data.timer.duration))


@pytest.mark.long
def test_mujoco_s_clock_stands_still_in_a_run_and_goes_on_afterwards(tmp_path):
    """One of the user's own goes on in the run too."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data, inside = mujoco.MjData(model), []

    def run():
        inside.clear()
        ffsm_mj.run(two_balls(tmp_path, duration_s=0.01), report=lambda *_: inside.append(timed(data, model)))
        return any(inside), timed(data, model)

    assert timed(data, model)
    assert run() == (False, True)
    with stopped_clock():
        assert run() == (False, False)
    assert timed(data, model)
    ticks = count()
    mujoco.set_mjcb_time(lambda: float(next(ticks)))
    try:
        assert run() == (True, True)
    finally:
        mujoco.set_mjcb_time(None)
    assert timed(data, model)


@pytest.mark.usefixtures("two")
def test_the_last_run_out_gives_blas_its_threads_back():
    """The first one out is not the first one in; four threads, each in and out in its turn."""
    gate = Barrier(4)

    def take(place):
        seen = []
        with one_blas_thread():
            gate.wait(10)
            seen.append(blas())
            if place:
                gate.wait(10)  # for the one that is out already
                seen.append(blas())
        if not place:
            gate.wait(10)
        return seen

    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(take, range(4))) == [[{1}], *[[{1}, {1}]] * 3]
    assert blas() == {2}
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        raise ZeroDivisionError
    assert blas() == {2}


def test_two_models_compiled_at_once_leave_the_filters_of_warnings_alone(tmp_path, monkeypatch):
    """The second begins while the first compiles, and would end after it: it puts back what it found, the first's filter."""
    part, second_in, first_done = composition.part, Event(), Event()
    path = two_balls(tmp_path, duration_s=0.01)
    before = list(warnings.filters)
    second = Thread(target=prepare, args=(path,))

    def meeting(*arguments):
        if current_thread() is second:
            second_in.set()
            first_done.wait(10)
        elif second.ident is None:
            second.start()
            second_in.wait(0.5)  # in vain where one waits for the other
        return part(*arguments)

    monkeypatch.setattr(composition, "part", meeting)
    prepare(path)
    first_done.set()
    second.join()
    assert list(warnings.filters) == before


def test_signals_are_handled_in_the_main_thread_only_and_handed_back():
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    seen = []

    def look():
        with noted() as interrupted:
            seen.append([signal.getsignal(number) for number in numbers])
            assert not interrupted()

    elsewhere(look)
    assert seen == [before]
    with noted() as interrupted:
        assert [signal.getsignal(number) for number in numbers] != before
        signal.raise_signal(signal.SIGTERM)
        assert interrupted()
    assert [signal.getsignal(number) for number in numbers] == before
