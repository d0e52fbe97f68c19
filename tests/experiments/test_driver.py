"""What a driver makes of interrupts and of workers that are lost, and what it goes on with."""

from __future__ import annotations

import os
import signal
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from pathlib import Path
from threading import Lock, Timer
from types import MappingProxyType
from typing import Any

import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.experiments import executors
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.driver import Driver, NoWorkersLeftError
from ffsm_mj.experiments.executors import WorkerLostError, Workers, loop
from ffsm_mj.experiments.store import RunRow
from ffsm_mj.experiments.worker import Job, probe
from ffsm_mj.report.output_place import new_file
from tests.experiments.files import campaign_file, rock_hits, two_rocks
from tests.experiments.laws import Fuse


class Interrupted(Fuse):
    """Ctrl-C comes while it is asked."""

    def control(self, *_: Any) -> None:
        os.kill(os.getpid(), signal.SIGINT)


def test_an_interrupted_run_interrupts_a_loop(tmp_path: Path) -> None:
    two_rocks(tmp_path, phases=[{"name": "only", "controller": {"kind": "fuse"}, "until": "end"}], duration_s=0.02)
    path = campaign_file(tmp_path, {"contacts.rules.second.restitution": {"uniform": [0.2, 1.0]}})
    campaign = Campaign.load(path, tmp_path / "out", controllers={"fuse": Interrupted})
    calls: list[float] = []
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            campaign.run(loop().open(), report=lambda *_: calls.append(0.0) if len(calls) < 9 else pytest.fail("goes on"))
    finally:
        signal.signal(signal.SIGINT, before)
    assert campaign.status().done == 0


class Lossy(Executor):
    """The worker of its first runs is lost after they have waited for long."""

    def __init__(self, losses: int) -> None:
        self._losses = losses

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if fn is probe:
            future.set_result("here")
        elif self._losses:
            self._losses -= 1
            future.set_exception(WorkerLostError("lost"))
        else:
            future.set_result([RunRow(args[1][0][0], "completed")])
        return future


@pytest.mark.parametrize(("losses", "outcome"), [(1, "completed"), (2, "timeout")])
def test_a_run_that_waited_is_not_late(losses: int, outcome: str) -> None:
    """A worker is lost after more than a run's time: whether its run or the wait before it took that, nobody knows.

    The second time it is handed to a worker without another run.
    """
    rows: list[RunRow] = []
    job = Job("", (), MappingProxyType({}), timeout_s=1e-9)
    Driver(Workers("lossy", 1, lambda: Lossy(losses)), job, rows.extend, lambda: False).drive([(0, {})])
    assert [(row.index, row.outcome) for row in rows] == [(0, outcome)]


class Refusing(Executor):
    """It is lost between two runs: it knows before the driver does, and refuses the next run."""

    opened = 0

    def __init__(self) -> None:
        Refusing.opened += 1
        self._left = 3 if Refusing.opened == 1 else 1000

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if fn is probe:
            future.set_result("here")
            return future
        if not self._left:
            raise BrokenProcessPool("lost")
        self._left -= 1
        future.set_result([RunRow(args[1][0][0], "completed")])
        return future


def test_a_run_that_is_refused_is_executed_later(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Refusing, "opened", 0)
    rows: list[RunRow] = []
    workers = Workers("refusing", 2, Refusing)
    Driver(workers, Job("", (), MappingProxyType({})), rows.extend, lambda: False).drive([(i, {}) for i in range(20)])
    assert Refusing.opened == 2
    assert sorted(row.index for row in rows) == list(range(20))


class Fragile(Executor):
    """A pool of three workers, one of which ends as soon as it begins a certain run."""

    workers, deadly = 3, 17

    def __init__(self, begun: list[list[int]]) -> None:
        self._begun, self._waiting = begun, dict[Future[Any], int]()
        # A run that is added while the last one is taken would else be waited for without end.
        self._lock = Lock()

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if fn is probe:
            future.set_result("here")
            return future
        with self._lock:
            if not self._waiting:
                Timer(0.001, self._work).start()
            self._waiting[future] = args[1][0][0]
        return future

    def _work(self) -> None:
        with self._lock:
            taken = dict(list(self._waiting.items())[: self.workers])
            self._begun.append(list(taken.values()))
            for future in taken:
                del self._waiting[future]
            if self._waiting:
                Timer(0.001, self._work).start()
        for future, index in taken.items():
            if index == self.deadly:
                future.set_exception(WorkerLostError("lost"))
            else:
                future.set_result([RunRow(index, "completed")])


def test_the_run_that_ends_its_worker_is_a_row_and_every_other_is_made_once() -> None:
    begun: list[list[int]] = []
    rows: list[RunRow] = []
    workers = Workers("fragile", Fragile.workers, lambda: Fragile(begun))
    Driver(workers, Job("", (), MappingProxyType({})), rows.extend, lambda: False).drive([(i, {}) for i in range(90)])
    assert sorted(row.index for row in rows) == list(range(90))
    assert [row.index for row in rows if row.outcome == "crashed"] == [Fragile.deadly]
    assert sorted(index for indices in begun for index in indices) == sorted([*range(90), Fragile.deadly])
    assert begun[-1] == [Fragile.deadly]


class Cut(Executor):
    """Its scheduler is gone after three runs: what was asked of it is cancelled, as by the client of a dask cluster."""

    def __init__(self) -> None:
        self._left = 3

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if fn is probe:
            future.set_result("here")
        elif self._left:
            self._left -= 1
            future.set_result(fn(*args))
        else:
            future.cancel()
            future.set_running_or_notify_cancel()  # or who waits for it is not told
        return future


@pytest.mark.long
def test_a_scheduler_that_does_not_come_back_is_a_loss_of_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows so far are kept, one line tells what happened, and the campaign goes on elsewhere to the same table."""
    opened: list[Cut] = []

    def connect() -> Any:
        if opened:
            raise InputError("--dask tcp://127.0.0.1:1: no scheduler answers there")
        opened.append(Cut())
        return nullcontext(opened[0])

    path = rock_hits(tmp_path)
    campaign = Campaign.load(path, tmp_path / "out")
    monkeypatch.setattr(executors, "dask", lambda _: Workers("2 dask workers", 2, connect))
    with pytest.raises(
        NoWorkersLeftError, match="no scheduler answers there; the rows so far are kept, resume continues the campaign"
    ):
        campaign.run(dask="tcp://127.0.0.1:1")
    assert (len(opened), campaign.status().done) == (1, 3)
    campaign.run(loop().open())
    whole = Campaign.load(path, tmp_path / "whole")
    whole.run(loop().open())
    assert [(row.index, row.metrics) for row in campaign.rows()] == [(row.index, row.metrics) for row in whole.rows()]
    assert campaign.status().outcomes == {"completed": 8}


def test_a_campaign_that_is_whole_is_not_stopped(tmp_path: Path) -> None:
    """Its only run fails: more than a half, but nothing is left to be made."""
    two_rocks(tmp_path, phases=[{"name": "only", "controller": {"kind": "fuse"}, "until": "end"}], duration_s=0.02)
    path = campaign_file(tmp_path, {"phases.0.controller.act": {"choice": ["raise"]}}, {"kind": "grid"})
    campaign = Campaign.load(path, tmp_path / "out", controllers={"fuse": Fuse})
    status = campaign.run(loop().open())
    assert (status.done, status.failed, status.left, status.stopped) == (1, 1, 0, "")


def test_who_opened_a_campaign_before_it_was_extended_sees_all_of_it(tmp_path: Path) -> None:
    path, out = rock_hits(tmp_path, samples={"kind": "random", "n": 2, "seed": 1}), tmp_path / "out"
    early = Campaign.load(path, out)
    other = Campaign.open(out)
    other.extend(3)
    assert early.run(loop().open()).runs == 3
    late = Campaign.open(out)
    other.extend(4)
    other.run(loop().open())
    assert (late.status().runs, late.table().num_rows) == (4, 4)


def test_a_campaign_file_in_the_way_is_kept(tmp_path: Path) -> None:
    path = rock_hits(tmp_path)
    out = tmp_path / "out"
    out.mkdir()
    (out / "campaign.yaml").write_text("# mine\n")
    with pytest.raises(InputError, match=r"holds campaign\.yaml, which would be overwritten"):
        Campaign.load(path, out)
    assert (out / "campaign.yaml").read_text() == "# mine\n"


def test_what_a_killed_process_left_is_not_in_the_way(tmp_path: Path) -> None:
    path, out = rock_hits(tmp_path), tmp_path / "out"
    out.mkdir()
    with new_file(out / "design.json") as unfinished:
        unfinished.write_text("{")
        assert Campaign.load(path, out).status().done == 0


def test_the_status_tells_failing_checks_by_name_and_size(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """In how many runs each fails, of whatever outcome, and where it is worst: infinite where a residual is no number."""
    campaign = Campaign.load(rock_hits(tmp_path), tmp_path / "out")
    fails = {
        1: {"excess.energy": 4.0},
        2: {"excess.energy": 40.0, "excess.no_penetration": 2.5},
        4: {"excess.energy": 40.0},
        5: {"excess.no_penetration": None},
    }
    with campaign._writable_table() as store:
        store.add([RunRow(i, "completed", metrics={"checks_pass": i not in fails, **fails.get(i, {})}) for i in range(7)])
        store.add([RunRow(7, "diverged", "too fast", metrics={"checks_pass": False, "excess.energy": 1.5})])
    checks = campaign.status().checks
    assert [(each.name, each.runs, each.excess, each.worst) for each in checks] == [
        ("energy", 4, 40.0, 2),
        ("no penetration", 2, float("inf"), 5),
    ]
    assert main(["campaign", "status", str(tmp_path / "out")]) == 0
    said = capfd.readouterr().out.splitlines()
    assert "  run 2: checks fail: energy (40 times its tolerance), no penetration (2.5 times its tolerance)" in said
    assert said[-2:] == [
        "  check fails in 4 runs: energy, at worst 40 times its tolerance, run 2",
        "  check fails in 2 runs: no penetration, at worst inf times its tolerance, run 5",
    ]


@pytest.mark.parametrize("missed", [8, 7])
def test_a_bound_that_every_run_misses_can_be_lifted(tmp_path: Path, capfd: pytest.CaptureFixture[str], missed: int) -> None:
    """What the scenario asks of the end of a run is no fault of the run; a check of physics is never lifted."""
    campaign = Campaign.load(rock_hits(tmp_path), tmp_path / "out")
    excess = {"excess.stack_momentum_at_the_end": 2.0, "excess.energy": 3.0}
    with campaign._writable_table() as store:
        rows = ({"checks_pass": False, **excess} if i < missed else {"checks_pass": True} for i in range(8))
        store.add([RunRow(i, "completed", metrics=metrics) for i, metrics in enumerate(rows)])
    assert main(["campaign", "status", str(tmp_path / "out")]) == 0
    said = capfd.readouterr().out.splitlines()
    (place,) = (i for i, line in enumerate(said) if "fails in" in line and "stack momentum at the end" in line)
    assert [i for i, line in enumerate(said) if "terminal: null" in line] == ([place + 1] if missed == 8 else [])


class Busy(Executor):
    """Makes the first run at once, has begun the second, and has the others wait."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if fn is probe:
            future.set_result("here")
            return future
        self.asked.append(args[1][0][0])
        if len(self.asked) == 1:
            future.set_result([RunRow(args[1][0][0], "completed")])
        elif len(self.asked) == 2:
            future.set_running_or_notify_cancel()
            Timer(0.1, future.set_result, [[RunRow(args[1][0][0], "completed")]]).start()
        return future


def test_what_was_begun_before_a_stop_is_kept() -> None:
    """It is made to its end anyway; what waits is not."""
    rows: list[RunRow] = []
    executor = Busy()
    workers = Workers("busy", 1, lambda: nullcontext(executor))
    Driver(workers, Job("", (), MappingProxyType({})), rows.extend, lambda: True).drive([(i, {}) for i in range(8)])
    assert len(executor.asked) == 4
    assert [row.index for row in rows] == [0, 1]
