"""Every way a run can end, each with its log kept and readable."""

from __future__ import annotations

import json
import os
import signal
import time

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.assembly.run import simulate
from ffsm_mj.controller_protocol import Command
from ffsm_mj.errors import ControllerError
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from tests.scenes import ball, box, scene, two_balls
from tests.ticks import in_the_loop


def run_and_read(path, folder, **kwargs):
    run = ffsm_mj.run(path, out=folder / "out", rerun=False, **kwargs)
    read = ffsm_mj.load_run(folder / "out")
    assert (read.outcome, read.message) == (run.outcome, run.message)
    return read


def test_completed_with_and_without_impacts(tmp_path):
    assert run_and_read(two_balls(tmp_path), tmp_path).outcome == "completed"
    run = ffsm_mj.run(two_balls(tmp_path, duration_s=0.1))
    assert (run.outcome, run.impacts) == ("completed", ())


def test_stop_on_impact(tmp_path):
    run = run_and_read(two_balls(tmp_path, stop_on_impact=True), tmp_path)
    assert run.outcome == "completed"
    assert run.time[-1] == run.impacts[0].time_s == pytest.approx(0.3, abs=1e-13)
    assert run.summary()["duration_s"] == run.time[-1]
    # 2 kg at 1 m/s on 3 kg at rest, e = 1: the last sample is the state after the hit.
    np.testing.assert_allclose(run.qvel[-1], (-0.2, 0.8), atol=1e-14)


def test_stop_on_impact_without_an_impact(tmp_path):
    """The run goes on to its end."""
    run = run_and_read(two_balls(tmp_path, stop_on_impact=True, duration_s=0.2), tmp_path)
    assert (run.outcome, run.time[-1], run.impacts) == ("completed", 0.2, ())


def super_elastic(robot_geom, object_geom):
    return [{"between": [robot_geom, object_geom], "restitution": 1.5, "super_elastic": True}]


def test_super_elastic_gains_energy_and_keeps_its_books(tmp_path):
    """E = 1.5 at 1 m/s, effective mass 2 * 3 / 5 kg: (e^2 - 1) u^2 / 2 times that is 0.75 J gained; every check passes."""
    run = run_and_read(two_balls(tmp_path, contacts={"rules": super_elastic("ball", "target/target")}), tmp_path)
    assert run.outcome == "completed"
    assert run.impacts[0].energy_change_J == pytest.approx(0.75, rel=1e-14)  # some ten operations of 1.1e-16 each
    assert run.impacts[0].separation_speed_m_s == pytest.approx(1.5, rel=1e-14)
    assert all(check.passes for check in all_checks(run))


def test_super_elastic_faces_end_the_run(tmp_path):
    """A face on a face are several contacts at once."""
    path = scene(
        tmp_path,
        box("a"),
        {"b": box("b")},
        duration_s=0.5,
        initial={"joints": {"b/free": [1.2, 0, 0, 1, 0, 0, 0]}, "rates": {"robot/free": [1, 0, 0, 0, 0, 0]}},
        contacts={"rules": super_elastic("robot/a", "b/b")},
    )
    run = run_and_read(path, tmp_path)
    assert run.outcome == "unsupported_contact"
    assert "super-elastic impacts (e > 1) are for one contact at a time" in run.message


def test_diverged(tmp_path):
    """A PD gain far beyond what 10 ms can hold blows up; MuJoCo's own words are kept, its log file is not written."""
    path = two_balls(
        tmp_path,
        contacts={"rules": []},
        duration_s=30.0,
        time_step_s=0.01,
        control_period_s=0.01,
        phases=[{"name": "p", "until": "end", "controller": {"kind": "pd", "joints": ["robot/x"], "kp": 1e6, "kd": 0.0}}],
    )
    run = run_and_read(path, tmp_path)
    assert run.outcome == "diverged"
    assert "huge value" in run.message
    assert np.isfinite(run["state.q_robot_x_m"]).all()
    assert run.time[-1] < 30.0
    assert not list(tmp_path.rglob("MUJOCO_LOG.TXT"))


@pytest.mark.parametrize("rate", [1e9, 1e7])
def test_absurd_speeds_end_the_run_and_never_hang(tmp_path, rate):
    """A closing speed that no sub-step can follow, or that is not finite: one clear line, soon."""
    path = scene(
        tmp_path,
        ball("ball", radius=0.001, joints="xy"),
        {"target": ball("target", radius=0.001, joints="xy")},
        initial={"joints": {"target/x": 1e3, "target/y": 0.5}, "rates": {"robot/x": rate}},
        duration_s=0.01,
        contacts={"rules": [{"between": ["ball", "target/target"]}]},
    )
    run = run_and_read(path, tmp_path)
    assert run.outcome in ("diverged", "completed")
    assert run.impacts == ()
    assert "\n" not in run.message


def test_event_limit(tmp_path):
    """A ball between two heavy ones bounces until the limit."""
    path = scene(
        tmp_path,
        ball("ball", joints="x"),
        {n: ball(n, mass=1e6, joints="x") for n in ("left", "right")},
        duration_s=3.0,
        initial={"joints": {"left/x": -0.3, "right/x": 0.3}, "rates": {"robot/x": 2.0}},
        contacts={"rules": [{"between": ["robot/ball", f"{n}/{n}"]} for n in ("left", "right")]},
        impact={"max_impacts": 7},
    )
    run = run_and_read(path, tmp_path)
    assert run.outcome == "event_limit"
    assert len(run.impacts) == 7
    assert "raise impact.max_impacts" in run.message


def test_unsupported_contact(tmp_path):
    """Newton's law does not cover face on face with a corner that leaves: the run ends rather than guess."""
    path = scene(
        tmp_path,
        box("block"),
        {"wall": box("wall")},
        initial={"joints": {"wall/free": [1.0, 0, 0, 1, 0, 0, 0]}, "rates": {"robot/free": [0.1, 0, 0, 0, 0, 1]}},
        contacts={"rules": [{"between": ["block", "wall/wall"]}]},
        impact={"law": "newton"},
    )
    run = run_and_read(path, tmp_path)
    assert run.outcome == "unsupported_contact"
    assert "'newton' needs equal restitution and no contact that separates; use 'poisson'" in run.message


class Unprintable(Exception):
    def __str__(self):
        raise ValueError("no text")


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (ControllerError("no gain"), "no gain"),
        (ZeroDivisionError("division by zero"), "ZeroDivisionError: division by zero"),
        (RuntimeError("Maximum number of iterations reached."), "RuntimeError: Maximum number of iterations reached."),
        (AssertionError(), "AssertionError"),
        (NotImplementedError("later"), "NotImplementedError: later"),
        (MemoryError("huge"), "MemoryError: huge"),
        (OSError(5, "no such table"), "OSError: [Errno 5] no such table"),
        (Exception("two\nlines and half a \ud83d"), "Exception: two lines and half a \\ud83d"),
        (RuntimeError("x" * 1000), f"RuntimeError: {'x' * 300}..."),
        (Unprintable(), "Unprintable"),
        (None, "the controller commands a non-finite effort for robot/push_x"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Exception) else None,
)
def test_controller_failed(tmp_path, fault, words):
    """Whatever a control law raises: the outcome, one line that says whose fault it was, and a closed log."""
    parts = prepare(two_balls(tmp_path, gap=5.0)).assemble()

    def fail(observation, command: Command):
        if observation.time_s >= 0.2 - 1e-9:
            if fault is not None:
                raise fault
            command.drive(np.array([0]), np.array([np.nan]))

    parts.controller.phases[0].controller.control = fail
    run = simulate(parts, RunFolder(tmp_path / "out"))
    assert run.outcome == "controller_failed"
    said, _, place = run.message.partition(" (test_outcomes.py:")
    assert said == f"phase 'coast' (off) at t = 0.2 s: {words}"
    assert place  # of what raised, or of the method that commanded what was refused
    read = ffsm_mj.load_run(tmp_path / "out")
    assert read.path.name == "run.mcap"
    assert (read.outcome, read.message) == (run.outcome, run.message)
    assert read.time[-1] == pytest.approx(0.199)
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["message"] == run.message


@pytest.mark.parametrize("method", ["start", "control", "telemetry"])
def test_controller_failed_at_an_impact(tmp_path, method):
    """The phase that the impact begins fails in each of its methods: the impact before it is in the log."""
    phases = [
        {"name": "approach", "until": "impact", "controller": {"kind": "off"}},
        {"name": "after", "until": "end", "controller": {"kind": "off"}},
    ]
    parts = prepare(two_balls(tmp_path, phases=phases)).assemble()
    controller = parts.controller.phases[1].controller
    controller.telemetry_signals = (object(),)  # so that it is asked for a report

    def fail(*_):
        raise RuntimeError("not now")

    setattr(controller, method, fail)
    run = simulate(parts, RunFolder(tmp_path / "out"))
    assert run.outcome == "controller_failed"
    assert run.message.startswith("phase 'after' (off) at t = 0.3 s: RuntimeError: not now (test_outcomes.py:")
    read = ffsm_mj.load_run(tmp_path / "out")
    assert len(read.impacts) == 1
    assert [phase.name for phase in read.phases] == ["approach", "after"]


def test_a_command_that_is_not_finite_at_an_impact(tmp_path):
    """The record of the impact carries the efforts that act after it: none do."""
    parts = prepare(two_balls(tmp_path)).assemble()

    def fail(observation, command: Command):
        if observation.events:
            command.drive(np.array([0]), np.array([np.nan]))

    parts.controller.phases[0].controller.control = fail
    run = simulate(parts, RunFolder(tmp_path / "out"))
    assert run.outcome == "controller_failed"
    assert len(ffsm_mj.load_run(tmp_path / "out").impacts) == 1
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["outcome"] == "controller_failed"


def test_leaving_the_program_is_no_fault_of_a_controller(tmp_path):
    """``sys.exit`` in a control law leaves, with everything so far in the log."""
    parts = prepare(two_balls(tmp_path, gap=5.0)).assemble()

    def leave(observation, _):
        if observation.time_s >= 0.2 - 1e-9:
            raise SystemExit(7)

    parts.controller.phases[0].controller.control = leave
    with pytest.raises(SystemExit):
        simulate(parts, RunFolder(tmp_path / "out"))
    read = ffsm_mj.load_run(tmp_path / "out")
    assert read.time[-1] == pytest.approx(0.199)
    assert not read.complete


def test_a_fault_of_our_own_is_not_hidden_and_costs_no_data(tmp_path, monkeypatch):
    """A defect at an event is an outcome of its own; what came before is in the log."""
    parts = prepare(two_balls(tmp_path)).assemble()

    def defect(*_):
        raise RuntimeError("a defect")

    monkeypatch.setattr("ffsm_mj.contact_models.impact.model.impact_energies", defect)
    simulate(parts, RunFolder(tmp_path / "out"))
    run = ffsm_mj.load_run(tmp_path / "out")
    assert run.outcome == "internal_error"
    assert run.message.startswith("at t = 0.3 s: RuntimeError: a defect (test_outcomes.py:")
    assert run.time[-1] == pytest.approx(0.3, abs=2e-3)


def test_mujocos_own_errors_end_the_run(tmp_path, monkeypatch):
    def fatal(*_, **__):
        raise mujoco.FatalError("mj_stackAlloc: insufficient memory")

    in_the_loop(monkeypatch)
    monkeypatch.setattr(EventDrivenIntegrator, "advance", fatal)
    run = run_and_read(two_balls(tmp_path), tmp_path)
    assert run.outcome == "diverged"
    assert "MuJoCo gave up (FatalError: mj_stackAlloc: insufficient memory)" in run.message


def test_interrupted(tmp_path):
    """A second Ctrl-C, or one inside a library: the log is closed all the same."""

    def stop(time_s, _):
        if time_s >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ffsm_mj.run(two_balls(tmp_path), out=tmp_path / "out", rerun=False, report=stop)
    run = ffsm_mj.load_run(tmp_path / "out")
    assert run.outcome == "interrupted"
    assert run.time[-1] == pytest.approx(0.5)


def test_an_impact_tells_its_step_and_the_efforts_that_act_from_there_on(tmp_path):
    """0.3005 s lies in step 300 of 1 ms. 2 kg at 1 m/s on 3 kg goes back at 0.2 m/s: a damper of 2 N s/m gives 0.4 N."""
    phases = [
        {"name": "coast", "until": "impact", "controller": {"kind": "off"}},
        {"name": "brake", "until": "end", "controller": {"kind": "pd", "joints": ["robot/x"], "kp": 1.0, "kd": 2.0}},
    ]
    run = run_and_read(two_balls(tmp_path, gap=0.3005, duration_s=0.4, phases=phases), tmp_path)
    (impact,) = run.impacts
    assert impact.step == 300
    assert impact.efforts_after["robot/push_x"] == (pytest.approx(0.4, abs=1e-12),)
    assert [phase.name for phase in run.phases] == ["coast", "brake"]


@pytest.mark.parametrize("ticks", [1, 1000])
def test_a_signal_is_heard_in_free_flight(tmp_path, ticks):
    """Between two ticks of the core, and between the steps of a long one: an hour of flight ends at once."""
    begin = time.monotonic()
    ffsm_mj.run(two_balls(tmp_path, gap=100.0, duration_s=1.0), out=tmp_path / "short", rerun=False)
    # What a run takes before and after its flight, of which a busy machine makes more or less.
    setup_s = time.monotonic() - begin
    path = two_balls(tmp_path, gap=100.0, duration_s=3600.0, control_period_s=3600.0 / ticks)
    signal.setitimer(signal.ITIMER_REAL, 0.3 + setup_s)
    heard = signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), signal.SIGINT))
    try:
        with pytest.raises(KeyboardInterrupt):
            ffsm_mj.run(path, out=tmp_path / "out", rerun=False)
    finally:
        signal.signal(signal.SIGALRM, heard)
    run = ffsm_mj.load_run(tmp_path / "out")
    assert (run.outcome, run.complete, run.damage) == ("interrupted", True, "")
    assert 0.0 < run.summary()["duration_s"] < 3600.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("place", ["step", "event"])
def test_signals_are_heard_inside_a_tick(tmp_path, monkeypatch, number, place):
    """Between the steps of a long control period, and before each event; the log is finished."""
    path = two_balls(tmp_path, duration_s=2.0, control_period_s=1.0)
    owner, method = (EventDrivenIntegrator, "exchanges") if place == "step" else (EventDrivenIntegrator, "advance")
    whole = getattr(owner, method)

    def signalled(self, duration_s, **stepped):
        found = whole(self, duration_s, **stepped)
        if place == "step" or found[1] is not None:
            os.kill(os.getpid(), number)
            monkeypatch.setattr(owner, method, whole)
        return found

    in_the_loop(monkeypatch)
    monkeypatch.setattr(owner, method, signalled)
    with pytest.raises(KeyboardInterrupt):
        ffsm_mj.run(path, out=tmp_path / "out", rerun=False)
    run = ffsm_mj.load_run(tmp_path / "out")
    assert (run.outcome, run.complete, run.damage) == ("interrupted", True, "")
    assert run.summary()["duration_s"] == pytest.approx(1e-3 if place == "step" else 0.3)
    assert run.impacts == ()
