"""The benchmarks are run by hand; here only that they still can be, and that what they put clocks on is what runs use."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.assembly.run import simulate
from ffsm_mj.controller_protocol import Command

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
NAMES = [path.stem for path in sorted(BENCHMARKS.glob("*.py"))]


@pytest.fixture
def benchmark(monkeypatch):
    """A benchmark by name, without the switches that it sets for its process."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    for library in ("OPENBLAS", "OMP", "MKL"):
        monkeypatch.setenv(f"{library}_NUM_THREADS", "1")
    return importlib.import_module


@pytest.fixture(scope="module")
def moments():
    """`spatial` for ten ticks of reaching, and for ten ticks of recovering from a drift that makes the thrusters fire."""
    recover = prepare("spatial").scenario.phases[2].model_dump(mode="json", exclude_none=True)
    drifting = {"phases": [recover], "initial.rates": {"base": [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]}}
    return [prepare("spatial", {"duration_s": 0.05} | changes) for changes in ({}, drifting)]


@pytest.mark.parametrize("name", NAMES)
def test_what_a_benchmark_imports_is_there(name, benchmark):
    benchmark(name)


def test_every_part_that_is_timed_is_a_part_of_a_run(benchmark, moments, monkeypatch):
    """A clock on a method that nothing calls any more would leave its time to the rest, and nobody would see it."""
    tick = benchmark("tick")
    calls = dict.fromkeys(tick.CLOCKED, 0)
    for moment in moments:
        for name, cost in tick.clocked(moment, tick.CLOCKED).parts.items():
            calls[name] += cost.calls
    assert min(calls.values()) > 0
    monkeypatch.setattr(tick, "FIRST_TICKS", 2)
    parts = tick.in_core(moments[0], 5)
    assert [count for _, count in parts.values()] == [5, 1, 1, 5, 1, 1]


def test_recorded_equations_are_those_of_the_run(benchmark, moments):
    """One at each tick, and the solver alone gives their solutions; SciPy's, unpolished, leave more."""
    riccati = benchmark("riccati")
    equations = riccati.recorded(moments[0])
    assert len(equations) == 10
    assert len({one.A22.tobytes() for one in equations}) == 10
    for solver, left in ((riccati.ours, riccati.GREATEST_RESIDUAL), (riccati.scipys, 1e-11)):
        spent, residuals = solver(equations)
        assert np.all(spent > 0.0)
        assert np.all(residuals < left)


def test_generated_scenes_move_and_touch_nothing(benchmark):
    scenes, growth = benchmark("scenes"), benchmark("growth")
    for prepared in (scenes.coasting(3, objects=2, duration_s=0.02), scenes.regulated(7, duration_s=0.02)):
        run = prepared.run()
        assert run.outcome == "completed"
        assert not run.impacts
        assert len(prepared.system.objects) == len(prepared.scenario.contacts.rules)
        rates = [name for name in run.log.header.layout.keys if name.startswith("state.v_")]
        assert sum(bool(np.any(run[name])) for name in rates) > 6
        assert set(growth.measured(prepared, 1)) == {"bare", "run"}


def test_what_presses_in_a_benchmark_presses_all_the_while(benchmark):
    """And is free where it is said to be. A rod of 0.5 kg that is pushed with 1 N gives most of it to the box of 3 kg."""
    lasting = benchmark("lasting")
    for pad in lasting.PADS.values():
        force = simulate(lasting.pressed(pad, away_m=0.0, duration_s=0.01).assemble())["contact.pad_box_box_force_N"]
        assert force == pytest.approx(force[0], rel=1e-3)
        assert 0.5 < force[0] < 1.0
        free = simulate(lasting.pressed(pad, away_m=lasting.AWAY_M, duration_s=0.01).assemble())
        assert not free["contact.pad_box_box_force_N"].any()


def test_what_slides_in_a_benchmark_slides_all_the_while(benchmark):
    """On all four corners: friction of some 0.02 N takes less than a tenth of its momentum, 3 kg at 0.08 m/s."""
    lasting = benchmark("lasting")
    pad, slip = lasting.PADS[lasting.CORNERS], lasting.SLIP_M_S
    run = simulate(lasting.pressed(pad, away_m=0.0, mu=lasting.SMOOTH_MU, slip_m_s=slip).assemble())
    force, speed = run["contact.pad_box_box_force_N"], run["contact.pad_box_box_slip_m_s"]
    assert force.min() > 0.5
    assert speed.min() > 0.8 * slip


def test_ticks_of_a_capture_are_those_before_it_and_while_it_holds(benchmark, monkeypatch):
    """And both events are timed; a stretch has ticks of one kind only."""
    capture = benchmark("capture")
    for name, short in (("HELD_S", 0.03), ("AFTER_S", 0.02), ("STRETCH", 5)):
        monkeypatch.setattr(capture, name, short)
    cost = capture.measured(capture.holding())
    told = [cost.free_us, cost.held_us, cost.free_block_us, cost.capture_ms, cost.release_ms]
    assert min(told) > 0.0
    assert max(told) < 1e5
    free = capture.measured(capture.undeclared())
    assert free.free_us > 0.0
    assert np.isnan([free.held_us, free.held_block_us, free.capture_ms, free.release_ms]).all()
    ticks = [(1e-6 * i if i < 30 else 3e-6 * i, i >= 30) for i in range(60)]
    assert capture._of_stretches(ticks, held=False) == pytest.approx(1.0)
    assert capture._of_stretches(ticks, held=True) == pytest.approx(3.0)
    assert np.isnan(capture._of_stretches(ticks[:30], held=True))


def test_impacts_of_the_benchmark_of_friction_rub(benchmark):
    """Bodies do touch there, with friction at every contact, and every impact is solved."""
    friction = benchmark("friction")
    for count in (1, 3):
        scenes = [friction.scene(seed, count) for seed in range(4)]
        assert {friction.with_friction(one, "blend") for one in scenes} <= {"ok", "jammed", "energy_guard"}
        for one in scenes:
            found = friction.impact_with_friction(one.A, one.w, one.mu, one.e, "blend")
            assert np.any(found.friction_work < 0.0)
        cost = friction.cost(count, lambda one: friction.with_friction(one, "poisson"), 4)
        assert 0.0 < cost.median_ms <= cost.p95_ms


@pytest.fixture
def engine_runs(benchmark):
    """Modules of ``benchmarks/engine_runs`` by name."""
    return lambda name: benchmark(f"engine_runs.{name}")


def test_engines_are_measured_against_the_exact_motion(engine_runs):
    """MuJoCo is no part of the references: its error falls by 2^4, from 2e-8 m at 20 ms, and exact states have none.

    Links of 0.5 m at 0.6 rad/s: rounding of 1000 steps is below 1e-13.
    """
    scene, measures, mujoco = (engine_runs(name) for name in ("scene", "measures", "with_mujoco"))
    flight = scene.free_flight()
    assert measures.errors(flight, measures.reference(flight))["position_m"] == 0.0
    off = [measures.errors(flight, mujoco.run(flight, mujoco.free("RK4"), h)[0])["position_m"] for h in (0.02, 0.01)]
    assert off[0] < 1e-7
    assert off[0] / off[1] == pytest.approx(16.0, rel=0.1)


def test_ours_among_the_engines(engine_runs):
    """A collision to rounding at 0.1 s, where a hit at the end of the step is 0.016 m off; no slip; a weld without drift.

    The weld: truncation of order four, from 3e-8 m at 0.05 s.
    """
    scene, measures, ours = (engine_runs(name) for name in ("scene", "measures", "with_ffsm"))
    for e in (1.0, 0.5):
        hit = scene.collision(e)
        off = measures.errors(hit, ours.run(hit, 0.1)[0])
        assert max(off["velocity"], off["position_m"], off["P"], off["L"]) < 1e-14
    held = measures.errors(scene.grip(), ours.run(scene.grip(), 0.1)[0])
    assert held["slip_rate_m_s"] < 1e-14
    assert held["P"] < 1e-11  # the target of the push is 1e12 m away, and 7 m of that are passed
    weld = scene.weld()
    off = measures.errors(weld, ours.run(weld, 0.05)[0])
    assert off["position_m"] < 1e-7
    assert off["drift_m"] < 1e-14
    assert off["load"] < 1e-6


def test_calibrated_restitutions(engine_runs):
    """Drake's force k x (1 + d v) integrated along a collision of unit mass; MuJoCo's spring and damper from its formula."""
    sweeps, mujoco = engine_runs("sweeps"), engine_runs("with_mujoco")
    d, h, x, v = sweeps.hunt_crossley(0.5, 1.0), 1e-5, 0.0, -1.0
    while x <= 0.0:  # depth -x; semi-implicit Euler, first order: 1e-5 of half a period of pi
        v += h * -x * max(0.0, 1.0 - d * v)
        x += h * v
    assert v == pytest.approx(0.5, abs=1e-4)
    ratio = mujoco.damping_ratio(0.5)
    x, v = 0.0, -1.0
    while x <= 0.0 and (force := -x - 2.0 * ratio * v) >= 0.0:
        v += h * force
        x += h * v
    assert v == pytest.approx(0.5, abs=1e-4)
    assert sweeps.hunt_crossley(1.0, 1.0) == mujoco.damping_ratio(1.0) == 0.0


def test_the_page_of_the_engines_is_made_of_its_numbers(engine_runs):
    page, docs = engine_runs("page"), BENCHMARKS.parent / "docs"
    assert page.text(json.loads((docs / "engines.json").read_text())) == (docs / "engines.md").read_text()


def test_contact_of_exudyn_is_on_the_faces_of_the_box(engine_runs):
    """Normals point outwards, as Exudyn asks for, and spheres that stand for a pad touch its face from inside."""
    exudyn, scene = engine_runs("with_exudyn"), engine_runs("scene")
    half = np.array([0.1, 0.5, 0.2])
    for number, face in enumerate(np.array(exudyn._faces(half))):
        outwards = np.sign(np.cross(face[1] - face[0], face[2] - face[0]))
        axis, sign = divmod(number, 2)
        assert outwards.tolist() == [(1.0, -1.0)[sign] * (i == axis) for i in range(3)]
        assert np.all(face @ outwards == half[axis])
    pad = scene.grip().body("left")
    reach = [np.abs(place) + radius for place, radius in exudyn._spheres(pad)]
    assert len(reach) == 4
    assert np.allclose(reach, pad.half_m, rtol=0.0, atol=1e-17)


def test_a_touch_begins_the_safety_pause_of_a_soft_run(benchmark):
    """The motors are on before it and off after it, as in the exact run."""
    soft = benchmark("soft_contact")
    (hit,) = prepare("baseline", {"duration_s": 7.8}).run().impacts
    run = soft.SoftRun(soft.RECIPES[0], 1e-3, hit)
    command = Command.off(int(run.model.nu))
    run.decide(0.0, command)
    assert np.any(run.data.ctrl[3:] != 0.0)
    run.decide(1e-3, command, touched=True)
    assert not np.any(run.data.ctrl)


def test_speculative_contact_acts_one_step_earlier_with_the_same_speeds(benchmark):
    """A damper 2 / h - 1 leaves 1 - h of the reversal: the effective mass of 2/3 kg has (1 - h)(-1) - 1 = -(2 - h) m/s.

    Rounding of speeds of 1 m/s over some 20 steps.
    """
    soft = benchmark("soft_contact")
    step = 2e-2
    off, on = (soft.head_on(step, speculative=flag) for flag in (False, True))
    assert off.contact_s - on.contact_s == pytest.approx(step)
    assert off.distance_m < on.distance_m == pytest.approx(-1e-3, abs=1e-12)
    for hit in (off, on):
        assert hit.sphere_m_s == pytest.approx(1.0 - 2.0 / 3.0 * (2.0 - step), abs=1e-12)
