"""A recipe runs as often as one likes, each time from the start, in any thread and any process, to the same bits."""

from __future__ import annotations

import os
import pickle
import random
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Barrier

import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.interface import ContactModel
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from tests.contact_models.grasp.test_closing import INSIDE, pushing
from tests.contact_models.impact.test_fixed import slab
from tests.contact_models.persistent.random_pushes import LAWS
from tests.contact_models.scenes import capture, spring
from tests.scenes import HEAD, ball, scene, two_balls

pytestmark = pytest.mark.usefixtures("example_contact_models")


def told(run):
    """Everything that a run tells, bit by bit, but for how long it took."""
    log = run.log
    return log.rows.tobytes(), repr((log.records, replace(log.outcome, wall_s=0.0, law_wall_s=0.0)))


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
        contacts={"rules": [{"between": ["robot/ball", f"{n}/{n}"], "restitution": 0.9} for n in ("left", "right")]},
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
        contacts={"rules": []},
        duration_s=5.0,
        time_step_s=0.01,
        control_period_s=0.01,
        phases=[{"name": "p", "until": "end", "controller": pull}],
    )


def tilting(folder, rods=6):
    """Rods that lie on a floor are pressed on it, and all tilted at one tick: each opens at one of its ends."""
    folder.mkdir(exist_ok=True)
    places = range(rods)
    parts = "".join(
        f"""<body name="rod{i}" pos="0 {0.3 * i} 0"><joint name="z{i}" type="slide" axis="0 0 1"/>
        <joint name="turn{i}" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.002"/>
        <geom name="rod{i}" type="capsule" fromto="-0.15 0 0 0.15 0 0" size="0.05" mass="0"/></body>"""
        for i in places
    )
    motors = "".join(f'<motor name="down{i}" joint="z{i}"/><motor name="turn{i}" joint="turn{i}"/>' for i in places)
    robot = f"""<mujoco>{HEAD}<worldbody><body name="base" pos="0 0 0.05"><joint name="x" type="slide" axis="1 0 0"/>
        <inertial pos="0 0 0" mass="5" diaginertia="0.1 0.1 0.1"/><geom name="hull" size="0.01" mass="0" pos="0 0 1"/>
        {parts}</body></worldbody><actuator>{motors}</actuator></mujoco>"""
    efforts = [-10.0, 0.0] * rods, [-10.0, 2.0] * rods
    return scene(
        folder,
        robot,
        {"floor": slab("floor", "1 5 0.1")},
        fixed={"floor": {"position_m": [0, 0, -0.1]}},
        duration_s=0.04,
        contacts={"rules": [{"between": [f"rod{i}", "floor/floor"], "restitution": 0.0} for i in places]},
        phases=[{"name": "p", "until": "end", "controller": {"kind": "pushes", "efforts": efforts, "hold_s": 0.02}}],
    )


def grasping(folder):
    """A grasp closes inside a step while its pair presses, and lets go at gap 0."""
    return pushing(folder, INSIDE)


def shipped(_):
    """The baseline: a law with warm starts on a free-floating base."""
    return "baseline"


RECIPES = {
    "bouncing": (bouncing, {}),
    "diverging": (diverging, {}),
    "baseline": (shipped, {"duration_s": 1.0}),
    "pushed": (spring, {"duration_s": 0.6}),
    "gripped": (capture, {"duration_s": 1.5}),
    "tilting": (tilting, {}),
    "grasping": (grasping, {}),
}
SEVERAL = ("bouncing", "pushed", "diverging", "tilting", "bouncing", "gripped")
"""Runs side by side; those of a name share one recipe."""


def recipe(name, folder):
    """A recipe by its name in RECIPES."""
    make, overrides = RECIPES[name]
    return prepare(make(folder / name), overrides, controllers=LAWS)


@pytest.mark.long
def test_the_recipes_are_what_they_should_be(tmp_path):
    """Impacts lie inside steps, contact models act, and one of the runs diverges: else the tests below would show little."""
    run = recipe("bouncing", tmp_path).run()
    inside = [impact.time_s / 1e-3 % 1.0 for impact in run.impacts]
    assert len(inside) >= 3
    assert any(0.01 < share < 0.99 for share in inside)
    assert run.log.unhandled
    assert recipe("diverging", tmp_path).run().outcome == "diverged"
    assert recipe("pushed", tmp_path).run().records["springs"]
    assert recipe("gripped", tmp_path).run().records["welds"]


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("name", ["tilting", "grasping"])
def test_no_order_comes_from_hashes(tmp_path, monkeypatch, name):
    """Objects that hash by their address come in another order in a set of every process: here by a random number."""
    seen = set()
    for seed in range(4):
        draw, given = random.Random(seed), {}

        def hashed(self, draw=draw, given=given):
            return given.setdefault(id(self), (draw.getrandbits(60), self))[0]

        with monkeypatch.context() as patched:
            for kind in (ContactPoint, ContactPair, ContactModel):
                patched.setattr(kind, "__hash__", hashed)
            run = recipe(name, tmp_path).run()
        assert len(run.records["contact_changes"]) == (6 if name == "tilting" else 0)
        seen.add(told(run))
    assert len(seen) == 1


@pytest.mark.long
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
def test_a_pickled_recipe_runs_to_the_same_rows(tmp_path, name):
    prepared = recipe(name, tmp_path)
    again = pickle.loads(pickle.dumps(prepared))
    assert told(again.run()) == told(prepared.run())


@pytest.mark.long
def test_recipes_run_in_other_processes(tmp_path):
    """After others, in another order, with other hashes of text: every bit of rows and records is the same."""
    recipes = {name: recipe(name, tmp_path) for name in ("bouncing", "tilting", "grasping")}
    here = {name: told(prepared.run()) for name, prepared in recipes.items()}
    (tmp_path / "recipes").write_bytes(pickle.dumps(recipes))
    code = """import pickle, sys
from pathlib import Path
from tests.assembly.test_fresh_runs import told
recipes = pickle.loads(Path(sys.argv[1]).read_bytes())
sys.stdout.buffer.write(pickle.dumps({name: told(recipes[name].run()) for name in sys.argv[2:]}))"""
    orders = [["tilting", "grasping", "bouncing"], ["grasping", "bouncing", "tilting"]]
    for seed, order in enumerate(orders, 1):
        command = [sys.executable, "-c", code, str(tmp_path / "recipes"), *order]
        environment = os.environ | {"PYTHONHASHSEED": str(seed)}
        answer = subprocess.run(command, capture_output=True, check=True, env=environment, cwd=Path(__file__).parents[2])
        there = pickle.loads(answer.stdout)
        assert {name for name in here if there[name] != here[name]} == set()


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


def test_what_is_looked_at_is_not_run_meanwhile():
    """A description of a scenario reads components at t = 0, whoever runs it at the same time."""
    prepared = prepare("coasting", {"duration_s": 0.1})

    def look(components):
        prepared.run()
        return [str(components.data.time)]

    assert prepared._looked_at(look) == ["0.0"]
    assert prepared.unused
    assert prepared.describe() == prepared.describe()
