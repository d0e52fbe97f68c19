"""A recipe runs as often as one likes, each time from the start, in any thread and any process, to the same bits."""

from __future__ import annotations

import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Barrier

import pytest

from ffsm_mj.assembly.prepare import prepare
from tests.regimes.scenes import capture, spring
from tests.scenes import ball, scene, two_balls

pytestmark = pytest.mark.usefixtures("test_regimes")


def told(run):
    """Everything that a run tells, bit by bit, but for how long it took."""
    log = run.log
    return log.rows.tobytes(), repr((log.records, replace(log.outcome, wall_s=0.0)))


def bouncing(folder):
    """A ball between two heavy ones hits inside steps, with a valve, a law that follows an impact, and its overlaps seen."""
    folder.mkdir(exist_ok=True)
    push = {"kind": "pd", "joints": ["robot/x"], "kp": 40.0, "kd": 1.0, "target": [0.05]}
    return scene(
        folder,
        ball("ball", joints="x"),
        {name: ball(name, mass=50.0, joints="x") for name in ("left", "right", "unseen")},
        duration_s=0.5,
        initial={"joints": {"left/x": -0.3, "right/x": 0.3, "unseen/x": 0.35}, "rates": {"robot/x": 2.0}},
        actuators={"robot/push_x": {"kind": "on_off", "force_N": 1.0, "threshold_N": 0.5, "min_on_time_s": 0.02}},
        impact_pairs=[
            {"robot_geom": "robot/ball", "object_geom": f"{n}/{n}", "restitution": 0.9} for n in ("left", "right")
        ],
        phases=[
            {"name": "coast", "until": "impact", "controller": {"kind": "off"}},
            {"name": "push", "until": "end", "controller": push},
        ],
    )


def diverging(folder):
    """A spring far too stiff for the step: MuJoCo warns, and the run is over."""
    folder.mkdir(exist_ok=True)
    pull = {"kind": "pd", "joints": ["robot/x"], "kp": 1e6, "kd": 0.0}
    return two_balls(
        folder,
        impact_pairs=[],
        duration_s=5.0,
        time_step_s=0.01,
        control_period_s=0.01,
        phases=[{"name": "p", "until": "end", "controller": pull}],
    )


def shipped(_):
    """The baseline: a law with warm starts on a free-floating base."""
    return "baseline"


RECIPES = {
    "bouncing": (bouncing, {}),
    "diverging": (diverging, {}),
    "baseline": (shipped, {"duration_s": 1.0}),
    "pushed": (spring, {"duration_s": 0.6}),
    "gripped": (capture, {"duration_s": 1.5}),
}
SEVERAL = ("bouncing", "pushed", "diverging", "bouncing", "bouncing", "gripped")
"""Runs side by side; those of a name share one recipe."""


def recipe(name, folder):
    """A recipe by its name in RECIPES."""
    make, overrides = RECIPES[name]
    return prepare(make(folder / name), overrides)


def test_the_recipes_are_what_they_should_be(tmp_path):
    """Impacts lie inside steps, regimes act, and one of the runs diverges: else the tests below would show little."""
    run = recipe("bouncing", tmp_path).run()
    inside = [impact.time_s / 1e-3 % 1.0 for impact in run.impacts]
    assert len(inside) >= 3
    assert any(0.01 < share < 0.99 for share in inside)
    assert run.log.unhandled
    assert recipe("diverging", tmp_path).run().outcome == "diverged"
    assert recipe("pushed", tmp_path).run().records["springs"]
    assert recipe("gripped", tmp_path).run().records["welds"]


@pytest.mark.parametrize("name", RECIPES)
def test_a_second_run_is_the_first_again(tmp_path, name):
    prepared = recipe(name, tmp_path)
    first = told(prepared.run())
    assert told(prepared.run()) == first
    assert told(recipe(name, tmp_path).run()) == first


def test_an_interrupted_run_leaves_nothing_to_the_next(tmp_path):
    prepared = recipe("bouncing", tmp_path)
    whole = told(prepared.run())

    def stop(time_s, _):
        if time_s >= 0.123:
            raise KeyboardInterrupt

    cut = prepared.run(report=stop)
    assert cut.outcome == "interrupted"
    assert told(prepared.run()) == whole
    assert told(prepared.run(report=stop)) == told(cut)


def test_nothing_of_a_recipe_is_written(tmp_path):
    """Not by a run, not by what is told of it; a model's bytes are all that it holds."""
    prepared = recipe("bouncing", tmp_path)
    before = pickle.dumps(prepared)
    prepared.run()
    assert any("overlap at the start" in line for line in prepared.describe())
    assert pickle.dumps(prepared) == before


@pytest.mark.long
@pytest.mark.parametrize("name", RECIPES)
@pytest.mark.parametrize("compiled", ["0", "1"])
def test_a_pickled_recipe_runs_to_the_same_rows(tmp_path, monkeypatch, name, compiled):
    """With the twins too, where they are installed."""
    monkeypatch.setenv("FFSM_COMPILED", compiled)
    prepared = recipe(name, tmp_path)
    again = pickle.loads(pickle.dumps(prepared))
    assert told(again.run()) == told(prepared.run())


def test_a_recipe_runs_in_another_process(tmp_path):
    prepared = recipe("bouncing", tmp_path)
    (tmp_path / "recipe").write_bytes(pickle.dumps(prepared))
    code = """import pickle, sys
from pathlib import Path
run = pickle.loads(Path(sys.argv[1]).read_bytes()).run(folder=None)
sys.stdout.buffer.write(run.log.rows.tobytes())"""
    command = [sys.executable, "-c", code, str(tmp_path / "recipe")]
    assert subprocess.run(command, capture_output=True, check=True).stdout == prepared.run().log.rows.tobytes()


@pytest.mark.long
def test_runs_in_threads_are_the_runs_in_a_row(tmp_path):
    """Six in four threads, all begun at once; what one installs or how it ends must not reach its neighbours."""
    recipes = {name: recipe(name, tmp_path) for name in dict.fromkeys(SEVERAL)}
    in_a_row = [told(recipes[name].run()) for name in SEVERAL]
    gate = Barrier(4)

    def run(place):
        begun = []

        def report(*_):
            if not begun and place < gate.parties:
                gate.wait(timeout=60)
            begun.append(True)

        return told(recipes[SEVERAL[place]].run(report=report))

    with ThreadPoolExecutor(gate.parties) as threads:
        assert list(threads.map(run, range(len(SEVERAL)))) == in_a_row
