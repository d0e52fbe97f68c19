"""Runs that end before their time: killed or interrupted before a capture, in it, while something is held, after it."""

from __future__ import annotations

import os
import signal
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.grasp.closing import ClosedGrasps
from ffsm_mj.contact_models.grasp.model import GraspModel
from ffsm_mj.log import recorder
from ffsm_mj.replay import replay_log
from tests.contact_models.grasp.scenes import grasping
from tests.ticks import at_each_tick

CAPTURE_S, RELEASE_S = 0.904, 1.804
# When, and how many grasps and releases the log has by then: one that happens is written before anything else does.
PARTS = {
    "before": (0.5, 0, 0),
    "in the capture": ("_close", 0, 0),
    "held": (1.2, 1, 0),
    "in the release": ("open", 1, 0),
    "after": (1.9, 1, 1),
}


def send(monkeypatch, when, number):
    """Let a signal come at a time of the simulation, or once a method of the contact model has done its work."""
    if isinstance(when, str):
        owner = ClosedGrasps if when == "open" else GraspModel
        method = getattr(owner, when)

        def done(self, *args, **named):
            found = method(self, *args, **named)
            os.kill(os.getpid(), number)
            return found

        monkeypatch.setattr(owner, when, done)
        return
    at_each_tick(monkeypatch, lambda time_s: os.kill(os.getpid(), number) if abs(time_s - when) < 1e-9 else None)


def killed(path, out, overrides=()):
    """Run in a child that kills itself; rows are flushed every few milliseconds."""
    child = os.fork()
    if not child:
        try:
            ffsm_mj.run(path, overrides, out=out, rerun=False)
        finally:
            os._exit(7)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


@pytest.mark.long
@pytest.mark.parametrize("part", PARTS)
def test_a_killed_run_tells_what_it_held(tmp_path, monkeypatch, capfd, part):
    when, grasps, releases = PARTS[part]
    path, out = grasping(tmp_path / "scene"), tmp_path / "out"
    with monkeypatch.context() as patched:
        send(patched, when, signal.SIGKILL)
        patched.setattr(recorder, "_FLUSH_PERIOD_S", 0.003)
        killed(path, out)
    read = ffsm_mj.load_run(out)
    assert read.outcome == "incomplete"
    found = [len(read.records[name]) for name in ("grasp_impulses", "releases")]
    assert found == [grasps, releases]
    assert [each.release_s is None for each in read.grasps] == [not releases] * grasps
    last = {"before": 0.499, "in the capture": CAPTURE_S - 1e-3, "held": 1.199, "in the release": RELEASE_S, "after": 1.899}
    assert last[part] - 0.2 < read.time[-1] < last[part] + 2e-3
    assert read["contact.grasp_closed"][-1] == float(grasps > releases)
    assert all(check.passes for check in all_checks(read))
    assert replay_log(read.log).agrees, replay_log(read.log).worst
    assert main(["analyze", str(out)]) == 4
    said = capfd.readouterr().out
    assert "incomplete" in said
    assert ("capture grasp:" in said) == bool(grasps)
    assert ("release of 'grasp'" in said) == bool(releases)


@pytest.mark.long
@pytest.mark.parametrize("part", PARTS)
def test_an_interrupted_run_is_whole_to_its_end(tmp_path, monkeypatch, part):
    """The first Ctrl-C lets what happens happen: a capture that has begun is in the log."""
    when, grasps, releases = PARTS[part]
    grasps, releases = grasps + (part == "in the capture"), releases + (part == "in the release")
    with monkeypatch.context() as patched:
        send(patched, when, signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            ffsm_mj.run(grasping(tmp_path / "scene"), out=tmp_path / "out", rerun=False)
    run = ffsm_mj.load_run(tmp_path / "out")
    assert run.outcome == "interrupted"
    read = ffsm_mj.load_run(tmp_path / "out")
    assert [len(read.records[name]) for name in ("grasp_impulses", "releases")] == [grasps, releases]
    assert read.summary()["grasps"] == run.summary()["grasps"]
    assert len(read.summary()["grasps"]) == grasps
    again = replay_log(read.log)
    assert again.agrees, again.worst
    assert all(check.passes for check in (*all_checks(read), *again.checks()))


def test_runs_of_one_scenario_know_nothing_of_each_other(tmp_path):
    """Twice after each other, and two at once: the pose at which the link holds is written into each run's own model."""
    prepared = prepare(grasping(tmp_path))
    first, second = prepared.run(), prepared.run()
    with ThreadPoolExecutor(2) as pool:
        others = [future.result() for future in [pool.submit(prepared.run) for _ in range(2)]]
    for run in (second, *others):
        np.testing.assert_array_equal(run.log.rows, first.log.rows)
        assert run.records["grasp_impulses"] == first.records["grasp_impulses"]
