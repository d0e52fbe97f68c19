"""The same rows wherever runs are made, whatever becomes of those who make them."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from ffsm_mj.errors import InputError, LogWriteError
from ffsm_mj.experiments import campaign as campaigns
from ffsm_mj.experiments import executors, worker
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.driver import NoWorkersLeftError
from ffsm_mj.experiments.executors import loop
from ffsm_mj.experiments.statistics import groups
from ffsm_mj.experiments.store import RunRow, Store
from ffsm_mj.experiments.worker import Job
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from tests.experiments.files import TUMBLING, campaign_file, two_rocks
from tests.experiments.laws import Fuse
from tests.scenes import ball
from tests.ticks import in_the_loop

METRICS = ["impacts.0.time_s", "impacts.0.impulse_N_s", "duration_s", "impacts.count"]
SPEED = {"initial.rates.robot/free.0": {"uniform": [0.8, 1.6]}}


def collisions(folder: Path, n: int = 8, **more: Any) -> Path:
    """Runs of 0.05 s in which the robot's ball hits the stone, at dispersed speeds and e."""
    rates = {"robot/free": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    two_rocks(
        folder,
        initial={"joints": {"stone/free": [0.22, 0, 0, 1, 0, 0, 0], "rock/free": TUMBLING}, "rates": rates},
        duration_s=0.05,
    )
    e = {"contacts.rules.second.restitution": {"uniform": [0.2, 1.0]}}
    return campaign_file(folder, e | SPEED, {"kind": "random", "n": n, "seed": 1}, metrics=METRICS, **more)


def told(campaign: Campaign) -> list[tuple[Any, ...]]:
    """What of the rows must be the same wherever they are made."""
    return [(row.index, row.outcome, dict(row.metrics), dict(row.model)) for row in campaign.rows()]


@pytest.fixture(scope="module")
def in_a_loop(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Any, ...]]:
    folder = tmp_path_factory.mktemp("loop")
    campaign = Campaign.load(collisions(folder), folder / "out")
    campaign.run(loop().open())
    return told(campaign)


def test_a_folder_that_holds_another_campaign_now_is_read_anew(tmp_path: Path) -> None:
    """In a process that has made runs of the one before: another scenario, or another model under the same name.

    J = (1 + e) v m M / (m + M) with m = 1 kg: twice as much at twice the speed, and 3/2 of that with M = 3 kg instead of 1.
    """
    found = []
    for speed, mass in ((1.0, 1.0), (2.0, 1.0), (2.0, 3.0)):
        path = collisions(tmp_path, n=1, overrides={"initial.rates.robot/free": [speed, 0.0, 0.0, 0.0, 0.0, 0.0]})
        (tmp_path / "stone.xml").write_text(ball("stone", mass=mass))
        stated = json.loads(path.read_text()) | {"dispersions": {"contacts.rules.0.restitution": {"uniform": [0.2, 1.0]}}}
        path.write_text(json.dumps(stated))
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        campaign = Campaign.load(path, tmp_path / "out")
        campaign.run(loop().open())
        found.append(campaign.rows()[0].metrics["impacts.0.impulse_N_s"])
    assert found[1] == pytest.approx(2.0 * found[0], rel=1e-9)
    assert found[2] == pytest.approx(1.5 * found[1], rel=1e-9)


def test_runs_hit(in_a_loop: list[tuple[Any, ...]]) -> None:
    """Two free balls: J = (1 + e) m1 m2 / (m1 + m2) v; the runs differ, so that equal tables mean something."""
    assert [row[1] for row in in_a_loop] == ["completed"] * 8
    assert len({row[2]["impacts.0.impulse_N_s"] for row in in_a_loop}) == 8


@pytest.mark.long
def test_a_pool_makes_the_rows_of_a_loop(tmp_path: Path, in_a_loop: list[tuple[Any, ...]]) -> None:
    campaign = Campaign.load(collisions(tmp_path), tmp_path / "out")
    status = campaign.run(workers=2)
    assert (status.done, status.failed, status.left) == (8, 0, 0)
    assert told(campaign) == in_a_loop


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # of distributed, about its own sockets
def test_dask_makes_the_rows_of_a_loop(tmp_path: Path, in_a_loop: list[tuple[Any, ...]]) -> None:
    distributed = pytest.importorskip("distributed")
    campaign = Campaign.load(collisions(tmp_path), tmp_path / "out")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        campaign.run(dask=cluster.scheduler_address)
    assert told(campaign) == in_a_loop


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # of distributed, about its own sockets
def test_dask_workers_with_several_threads_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    campaign = Campaign.load(collisions(tmp_path), tmp_path / "out")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=None) as cluster,
        pytest.raises(InputError, match="has 2 threads; start it with --nthreads 1"),
    ):
        campaign.run(dask=cluster.scheduler_address)
    monkeypatch.setattr(executors, "_ANSWER_S", 1)
    with pytest.raises(InputError, match=r"dask='tcp://127\.0\.0\.1:1': no scheduler answers there"):
        campaign.run(dask="tcp://127.0.0.1:1")


def fused(folder: Path, acts: list[str], **more: Any) -> Path:
    two_rocks(folder, phases=[{"name": "only", "controller": {"kind": "fuse"}, "until": "end"}], duration_s=0.1)
    return campaign_file(folder, {"phases.0.controller.act": {"choice": acts}}, {"kind": "grid"}, metrics=METRICS, **more)


@pytest.mark.long
def test_a_run_that_kills_its_worker_is_one_row(tmp_path: Path) -> None:
    path = fused(tmp_path, ["nothing", "kill", "raise"], limits={"max_failed": 1.0})
    campaign = Campaign.load(path, tmp_path / "out", controllers={"fuse": Fuse})
    status = campaign.run(workers=2)
    assert [row.outcome for row in campaign.rows()] == ["completed", "crashed", "controller_failed"]
    assert (status.done, status.failed) == (3, 2)
    assert "the fuse is blown" in campaign.rows()[2].message
    assert status.messages[0].startswith("run 1: crashed: BrokenProcessPool")


@pytest.mark.long
def test_a_stuck_run_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that sleeps in C is ended with its worker, one that is slow in Python by itself, however busy the machine is."""
    monkeypatch.setattr(campaigns, "Job", partial(Job, grace_s=0.1))
    path = fused(tmp_path, ["dawdle", "stick"], limits={"max_failed": 1.0, "timeout_s": 0.2})
    campaign = Campaign.load(path, tmp_path / "out", controllers={"fuse": Fuse})
    campaign.run(workers=1)
    rows = campaign.rows()
    assert [row.outcome for row in rows] == ["timeout", "timeout"]
    assert rows[0].message == "took more than 0.2 s"
    assert rows[1].message == "took more than 0.2 s and did not stop"


def test_too_many_failures_stop_a_campaign(tmp_path: Path) -> None:
    campaign = Campaign.load(fused(tmp_path, ["raise", "nothing"]), tmp_path / "out", controllers={"fuse": Fuse})
    campaign.config = campaign.config.model_copy(
        update={"limits": campaign.config.limits.model_copy(update={"max_failed": 0.4})}
    )
    status = campaign.run(loop().open(), retry=("error",))
    assert status.stopped == "1 of the first 2 runs failed, more than limits.max_failed = 0.4"


def test_a_campaign_ends_when_enough_is_known(tmp_path: Path) -> None:
    """All runs succeed: the Wilson interval of k of k is z^2 / (k + z^2) wide, 0.324 for 8 and 0.194 for 16 runs."""
    path = collisions(tmp_path, n=64, success="impacts.count == 1", stop={"metric": "success", "width": 0.2})
    campaign = Campaign.load(path, tmp_path / "out")
    status = campaign.run(loop().open())
    assert (status.done, status.left, status.stopped) == (16, 48, "")
    assert status.enough == "the 95 % interval of success is narrower than 0.2 after 16 runs"
    assert campaign.run(loop().open()).done == 16  # nor does it go on
    share = campaign.fraction()
    assert share.interval[1] - share.interval[0] == pytest.approx(0.194, abs=1e-3)
    spread = campaign.quantile("impacts.0.impulse_N_s", 0.5)
    values = sorted(row.metrics["impacts.0.impulse_N_s"] for row in campaign.rows())
    assert values[0] <= spread.value <= values[-1]


def test_a_pool_of_somebody_s_is_used_and_told_when_it_cannot(tmp_path: Path, in_a_loop: list[tuple[Any, ...]]) -> None:
    campaign = Campaign.load(collisions(tmp_path), tmp_path / "out")
    with ProcessPoolExecutor(1, initializer=_breaks) as broken, pytest.raises(InputError, match="needs if __name__"):
        campaign.run(broken)
    assert campaign.status().done == 0
    with ProcessPoolExecutor(2) as theirs:
        campaign.run(theirs)
    assert told(campaign) == in_a_loop


def _breaks() -> None:
    raise OSError("no worker here")


_SCRIPT = """
import ffsm_mj
values = {{"contacts.rules.second.restitution": [0.5, 1.0]}}
table = ffsm_mj.sweep({scene!r}, values, metrics=["impacts.0.impulse_N_s"], workers=2)
print(table.column("impacts.0.impulse_N_s").to_pylist())
"""


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("how", ["script", "stdin"])
def test_sweep_works_without_a_main_guard(tmp_path: Path, how: str) -> None:
    collisions(tmp_path)
    text = _SCRIPT.format(scene=str(tmp_path / "scene.yaml"))
    (tmp_path / "script.py").write_text(text)
    arguments = [sys.executable, "-" if how == "stdin" else str(tmp_path / "script.py")]
    done = subprocess.run(
        arguments, input=text if how == "stdin" else None, capture_output=True, text=True, timeout=120, check=True
    )
    elastic, half = sorted(map(float, done.stdout.strip("[]\n").split(",")), reverse=True)
    assert elastic / half == pytest.approx(2.0 / 1.5, rel=1e-12)
    assert not done.stderr


def test_laws_of_a_script_run_where_they_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import ffsm_mj

    class Mine(Fuse):
        """Defined here: no other process can import it."""

    two_rocks(tmp_path, phases=[{"name": "only", "controller": {"kind": "fuse"}, "until": "end"}], duration_s=0.02)
    values = {"phases.0.controller.act": ["nothing", "raise"]}
    table = ffsm_mj.sweep(tmp_path / "scene.yaml", values, metrics=METRICS, controllers={"fuse": Mine}, workers=2)
    assert table.column("outcome").to_pylist() == ["completed", "controller_failed"]
    assert "fuse cannot be imported by other processes: all runs are executed in this one" in capsys.readouterr().err


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_driver_that_is_killed_is_resumed_to_the_same_table(
    tmp_path: Path, in_a_loop: list[tuple[Any, ...]], number: signal.Signals
) -> None:
    """Killed once some rows are there. Random samples: the first eight are those of the smaller design."""
    path, out = collisions(tmp_path, n=32), tmp_path / "out"
    command = [sys.executable, "-m", "ffsm_mj.cli.main", "campaign", "run", str(path), "--out", str(out), "--workers", "2"]
    driver = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (out / "rows.sqlite").is_file() or Campaign.open(out).status().done == 0:
        assert driver.poll() is None
        time.sleep(0.02)
    driver.send_signal(number)
    assert driver.wait(timeout=30) == (130 if number is signal.SIGINT else -number)
    campaign = Campaign.open(out)
    before = campaign.status()
    assert 0 < before.done < 32
    campaign.run(workers=2)
    assert len(campaign.rows()) == 32
    assert told(campaign)[:8] == in_a_loop


@pytest.mark.long
def test_a_worker_that_is_killed_costs_nothing(tmp_path: Path, in_a_loop: list[tuple[Any, ...]]) -> None:
    """Nor is a run blamed for it: alone, it is made."""
    campaign = Campaign.load(collisions(tmp_path, n=32), tmp_path / "out")
    killed: list[int] = []

    def kill(done: float, _: float) -> None:
        if done >= 5 and not killed:
            killed.append(next(child.pid for child in multiprocessing.active_children() if child.pid))
            os.kill(killed[0], signal.SIGKILL)

    status = campaign.run(workers=2, report=kill)
    assert (len(killed), status.done, dict(status.outcomes)) == (1, 32, {"completed": 32})
    assert told(campaign)[:8] == in_a_loop


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # of distributed, about its own sockets
def test_a_scheduler_that_is_killed_is_a_loss_of_nothing(
    tmp_path: Path, in_a_loop: list[tuple[Any, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = Campaign.load(collisions(tmp_path, n=32), tmp_path / "out")
    dask, file = [sys.executable, "-m", "dask"], str(tmp_path / "scheduler.json")
    silent: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = subprocess.Popen([*dask, "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", file], **silent)
    workers = subprocess.Popen(
        [*dask, "worker", "--scheduler-file", file, "--nworkers", "2", "--nthreads", "1", "--no-dashboard"], **silent
    )
    try:
        address = _address(Path(file))

        def kill(done: float, _: float) -> None:
            if done >= 5:
                scheduler.kill()
                monkeypatch.setattr(executors, "_ANSWER_S", 1)

        with pytest.raises(NoWorkersLeftError, match="rows so far are kept"):
            campaign.run(dask=address, report=kill)
    finally:
        scheduler.kill()
        workers.terminate()
        scheduler.wait()
        workers.wait()
    assert 0 < campaign.status().done < 32
    campaign.run(workers=2)
    assert told(campaign)[:8] == in_a_loop
    assert campaign.status().outcomes == {"completed": 32}


def _address(file: Path) -> str:
    """Of a scheduler that has both workers."""
    from distributed import Client

    while not file.is_file() or not file.read_text():
        time.sleep(0.05)
    with Client(scheduler_file=str(file), set_as_default=False) as client:
        client.wait_for_workers(2)
        return str(client.scheduler.address)


def test_an_interrupted_replay_is_no_replay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its log is kept, and it is made again where it is asked for."""
    campaign = Campaign.load(collisions(tmp_path, keep={"worst": {"duration_s": 1}}), tmp_path / "out")
    campaign.run(loop().open())
    with monkeypatch.context() as patched:
        patched.setattr("ffsm_mj.assembly.run.noted", lambda: nullcontext(lambda: True))
        with pytest.raises(KeyboardInterrupt):
            campaign.rerun(0)
    assert (campaign.folder.rerun(0) / "run.mcap").is_file()
    assert not campaign.folder.has_rerun(0)
    assert campaign.rerun(0).verdict == "run 0 agrees with its row bit for bit"
    assert campaign.folder.has_rerun(0)


def test_a_second_driver_is_refused(tmp_path: Path) -> None:
    campaign = Campaign.load(collisions(tmp_path), tmp_path / "out")
    with campaign.folder.locked(), pytest.raises(InputError, match="another process is running this campaign"):
        campaign.run(loop().open())


def test_a_full_disk_keeps_what_is_there(tmp_path: Path) -> None:
    store = Store(tmp_path / "rows.sqlite", max_pages=12)
    store.begin("{}")
    kept = 0
    with suppress(LogWriteError):
        while True:
            store.add([RunRow(kept, "completed", metrics={"x": 0.1 * kept})])
            kept += 1
    assert kept > 0
    with pytest.raises(LogWriteError, match="database or disk is full"):
        store.add([RunRow(kept, "completed", message="x" * 10_000)])
    store.close()
    again = Store(tmp_path / "rows.sqlite", write=False)
    assert again.done() == set(range(kept))
    assert [row.metrics["x"] for row in again.rows()] == [0.1 * i for i in range(kept)]


def test_other_settings_are_refused_by_name(tmp_path: Path) -> None:
    path = collisions(tmp_path)
    Campaign.load(path, tmp_path / "out")
    with pytest.raises(InputError, match=r"sampling\.samples\.seed 1 there, 2 here"):
        Campaign.load(path, tmp_path / "out", overrides=["samples.seed=2"])
    Campaign.load(path, tmp_path / "out", overrides=["success=impacts.count == 1"])  # rows do not depend on it


def test_a_worker_with_other_packages_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = Campaign.load(collisions(tmp_path), tmp_path / "out")
    monkeypatch.setattr(worker, "row_versions", lambda: {"numpy": "1.0"})
    with pytest.raises(InputError, match=r"ffsm-mj none, where the campaign has"):
        campaign.run(loop().open())


@pytest.mark.long
@pytest.mark.parametrize("group", ["controllers", "metrics", "impact_laws", "contact_models"])
def test_versions_of_plugins_are_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: str) -> None:
    path = collisions(tmp_path)
    info = tmp_path / "site" / "some_plugin-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "entry_points.txt").write_text(f"[ffsm_mj.{group}]\nsomething = some_plugin:Thing\n")
    metadata = info / "METADATA"
    metadata.write_text("Metadata-Version: 2.1\nName: some_plugin\nVersion: 1.0\n")
    monkeypatch.syspath_prepend(info.parent)
    Campaign.load(path, tmp_path / "out").run(loop().open())
    metadata.write_text("Metadata-Version: 2.1\nName: some_plugin\nVersion: 1.1\n")
    with pytest.raises(InputError, match=r"versions\.some_plugin '1\.0' there, '1\.1' here"):
        Campaign.open(tmp_path / "out").run(loop().open())


def test_an_internal_error_is_a_failed_run_of_that_outcome(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And grouped by the exception's type."""
    campaign = Campaign.load(collisions(tmp_path, limits={"max_failed": 1.0}), tmp_path / "out")
    advance = EventDrivenIntegrator.advance

    def broken(course: EventDrivenIntegrator, duration_s: float, *, stepped: bool) -> Any:
        if course.kinetic_energy_J > 0.7:
            raise LookupError("on purpose")
        return advance(course, duration_s, stepped=stepped)

    in_the_loop(monkeypatch)
    monkeypatch.setattr(EventDrivenIntegrator, "advance", broken)
    status = campaign.run(loop().open())
    failed = status.outcomes["internal_error"]
    assert 0 < failed < 8
    assert (status.failed, status.outcomes["completed"]) == (failed, 8 - failed)
    (group,) = groups(campaign.results())
    assert (group.how, len(group.runs)) == ("internal_error (LookupError)", failed)
    assert group.message.startswith("at t = 0 s: LookupError: on purpose (")
