"""Every part needs what it remembers: a simulation that forgets one field of one state of it goes on otherwise."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import mujoco
import pytest

import ffsm_mj
from ffsm_mj.contact.normal import NormalSearch
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.sides import Sides
from ffsm_mj.contact.union_pair import UnionPair
from ffsm_mj.state import StateError, as_mappings
from tests.contact.features.test_gap_functions import in_contact, moved, pair_of
from tests.contact.features.test_stored import CASES as FEATURES
from tests.contact.test_geometry import shape
from tests.contact.unions.scenes import free, geoms
from tests.contact.unions.test_slides import CUBE, HALVES
from tests.contact_models.joint_friction.scenes import arm, rubbing
from tests.contact_models.joint_friction.test_chains import SWUNG
from tests.controllers.detumbling import JETS, POSE, RATES, spacecraft
from tests.forgetting import classes_with_state, forgetting
from tests.mechanisms.models import four_bar, mechanism
from tests.scenes import ball, compile_paths, scene, two_balls
from tests.simulation.restored import is_rest_of, rest

pytestmark = pytest.mark.usefixtures("example_contact_models")

OFF = {"kind": "off"}
UNTIL_IMPACT = [
    {"name": "before", "until": "impact", "controller": OFF},
    {"name": "after", "until": "end", "controller": OFF},
]


def turns(folder):
    """A linkage whose drift is projected out at 0.132 s, in the middle of a tick of ten steps."""
    steps = {"time_step_s": 4e-3, "control_period_s": 0.04, "duration_s": 0.4}
    return mechanism(folder, four_bar(), {"crank": 1.0472}, {"crank": 4.0}, **steps)


def busy(folder):
    """A ball in a grasp, one that a grasp misses, two that overlap, a wheel that moves the hub, and chosen sub-steps."""
    balls = {
        "rock": ball("rock", mass=8.0),
        "passing": ball("passing", extra='<site name="handle" pos="0.05 0 0"/>'),
        "left": ball("left"),
        "right": ball("right"),
    }
    places = {"rock": [0.9, 0, 0], "passing": [1.7, 0.3, 0.3], "left": [0, 5, 0], "right": [0.1, 5, 0]}
    grasps = {
        "grasp": {"robot_site": "tip", "object_site": "rock/centre", "when": {"within": {"position_m": 1e-3}}},
        "miss": {"robot_site": "tip", "object_site": "passing/handle", "when": {"within": {"position_m": 0.01}}},
    }
    return scene(
        folder,
        spacecraft(),
        balls,
        duration_s=0.5,
        accuracy=1e-6,
        time_step_s=0.02,
        control_period_s=0.02,
        initial={
            "joints": {f"{name}/free": [*place, 1, 0, 0, 0] for name, place in places.items()},
            "rates": {"passing/free": [-4.0, 0, 0, 0.5, 2.0, 0], "right/free": [0.3, 0, 0, 0, 0, 0], "shoulder": 0.2},
        },
        grasps=grasps,
        phases=[{"name": "all", "until": "end", "arm": [*grasps], "controller": {"kind": "hold", "bandwidth_rad_s": 1.0}}],
    )


def late(folder):
    """Valves that must stay open, a wheel, commands that arrive late at ticks that are late, and samples under way."""
    camera = {
        "kind": "framepos",
        "of": "rock/centre",
        "relative_to": "tip",
        "interval_s": 0.05,
        "delay_s": 0.06,
        "noise": 1e-3,
    }
    jet = {"kind": "on_off", "force_N": 5.0, "threshold_N": 0.5, "release_N": 0.25, "min_on_time_s": 0.07}
    law = {
        "kind": "base_pd",
        "thrusters": JETS,
        "translation": {"kp": 50.0, "kd": 37.5},
        "rotation": {"kp": 200.0, "kd": 150.0},
    }
    return scene(
        folder,
        spacecraft(jets="couples"),
        {"rock": ball("rock")},
        duration_s=0.5,
        time_step_s=0.02,
        control_period_s=0.02,
        seed=7,
        sensors={"camera": camera},
        estimator={"kind": "direct"},
        actuation={"delay_s": 0.03, "control_jitter_s": 0.005},
        actuators=dict.fromkeys(JETS, jet),
        initial={"joints": {"rock/free": [1.5, 0, 0, 1, 0, 0, 0], "base": POSE}, "rates": {"base": RATES}},
        phases=[{"name": "all", "until": "end", "controller": law}],
    )


SCENES: dict[str, tuple[Any, dict[str, Any], float, dict[str, str]]] = {
    "busy": (
        busy,
        {},
        0.3,
        {
            "EventCounter": "next",
            "ClosestApproach": "least",
            "Latch": "armed closest",
            "ClosedGrasps": "closed attached motion",
            "GraspModel": "latches closed",
            "StepControl": "steps",
            "EventDrivenIntegrator": "sources control",
            "ContactWatch": "open",
            "Simulation": "watch",
        },
    ),
    "late": (
        late,
        {},
        0.31,
        {
            "Command": "effort powered",
            "SensorGroup": "number shown under_way",
            "SensorSampler": "groups clock_s",
            "Valve": "firing lit_at_s",
            "Actuation": "counts valves",
            "DelayedControl": "under_way effective",
            "Plant": "data integrator actuation sampler",
        },
    ),
    "struck": (
        partial(two_balls, gap=0.31, time_step_s=0.02, control_period_s=0.06, duration_s=0.48, phases=UNTIL_IMPACT),
        {},
        -0.24,
        {
            "Progress": "left_s is_within_step",
            "Simulation": "due evaluation",
            "Evaluation": "pending",
        },
    ),
    "rubs": (
        lambda folder: rubbing(folder, arm(), 0.02, duration_s=0.32, **SWUNG),
        {},
        -0.2,
        {"JointFriction": "senses heat_J"},
    ),
    "turns": (
        turns,
        {},
        0.156,
        {"LoopForces": "combinations projection", "StateProjection": "largest_J"},
    ),
    "slides": (
        lambda _: "squeeze",
        {"duration_s": 0.2},
        0.184,
        {
            "DeepestOverlap": "deepest",
            "FrictionHeat": "total_J",
            "RuleGaps": "gaps",
            "ImpactModel": "overlap heat",
            "FrictionModes": "kinds directions largest_slip",
            "FrictionReport": "values work_J",
            "ClosedContacts": "closed pressing modes",
            "_ForceTable": "values",
            "PersistentContactModel": "closed logged contacts friction",
            "Balance": "numbers",
            "Plant": "numbers balance",
            "Progress": "steps ticks",
            "Simulation": "progress plant",
        },
    ),
}
"""Scenes, with overrides, a time at which their state is saved, s, and what they cannot do without, by class.

A negative time is that after which the state is saved at the next event, inside a step.
"""
CASES = [
    (scene, kind, field)
    for scene, (*_, needed) in SCENES.items()
    for kind, names in needed.items()
    for field in names.split()
]


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """For each scene: what :func:`rest` needs to go on from its state, and what that says."""

    @cache
    def state(name):
        made, given, time_s, _ = SCENES[name]
        path = made(tmp_path_factory.mktemp(name))
        simulator = ffsm_mj.Simulator(path, given)
        simulator.reset()
        simulator.step(until=abs(time_s))
        while time_s < 0.0 and not simulator.step(until="event").events:
            pass
        start = path, given, simulator.get_state().to_bytes()
        simulator.close()
        expected = rest(*start)
        assert is_rest_of(expected, rest(*start))
        return start, expected

    return state


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(("scene", "kind", "field"), CASES)
def test_a_field_that_is_forgotten(states, scene, kind, field):
    """The rest of the run differs, or there is none."""
    start, expected = states(scene)
    with forgetting(classes_with_state("ffsm_mj")[kind], field):
        try:
            forgetful = rest(*start)
        except (StateError, AssertionError, ValueError):
            return
    assert not is_rest_of(expected, forgetful)


def normals_that_differ(pair, model, data, rng, forgotten, nothing):
    """In how many of ten contacts the next normal is another one where a field of a class is forgotten.

    Args:
        pair: The pair.
        model: MuJoCo model.
        data: Its data.
        rng: Turns both bodies.
        forgotten: The class and its field.
        nothing: State of a pair that remembers nothing.
    """
    count = 0
    for _ in range(10):
        in_contact(pair, model, data, rng)
        state = as_mappings(pair.get_state())
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-1, 1, 12), 1e-5)
        moved(model, data)
        expected = pair.proximity(model, data).normal.tobytes()
        pair.set_state(state)
        assert pair.proximity(model, data).normal.tobytes() == expected
        pair.set_state(nothing)
        with forgetting(*forgotten):
            pair.set_state(state)
        count += pair.proximity(model, data).normal.tobytes() != expected
    return count


def test_the_last_normal(tmp_path, rng):
    """The next normal in contact is searched from it: to rounding, not to the last bit, does it matter where."""
    differ = dict.fromkeys((ContactPair, NormalSearch), 0)
    pair, model, data = pair_of(tmp_path, shape("ellipsoid"), shape("ellipsoid"))
    for kind, field in ((ContactPair, "search"), (NormalSearch, "last")):
        differ[kind] += normals_that_differ(pair, model, data, rng, (kind, field), {"search": {"last": None}})
    assert all(differ.values())


def test_the_last_normals_of_pieces(tmp_path, rng):
    """The same of the pieces of a union."""
    two = shape("ellipsoid").replace("</body>", '<geom name="h" type="sphere" size="0.05" mass="0"/></body>')
    (tmp_path / "robot.xml").write_text(shape("ellipsoid"))
    (tmp_path / "other.xml").write_text(two)
    system = compile_paths(tmp_path / "robot.xml", {"other": tmp_path / "other.xml"})
    model, data = system.mj, mujoco.MjData(system.mj)
    ids = [model.geom(name).id for name in ("robot/g", "other/g", "other/h")]
    sides = Sides(system, ids, 1e-9)
    both = sides.of(ids[0]), sides.of(ids[1])
    union = UnionPair(system, "union", both, [(ids[0], k) for k in ids[1:]], 0.5, 0.0, "rule")
    assert normals_that_differ(union, model, data, rng, (UnionPair, "pieces"), {"pieces": [], "last": -1})


def test_the_piece_that_was_nearest_last(tmp_path):
    """Of two pieces that are equally near: that from which the body came."""
    (tmp_path / "robot.xml").write_text(CUBE)
    (tmp_path / "floor.xml").write_text(free(geoms(HALVES)))
    system = compile_paths(tmp_path / "robot.xml", {"floor": tmp_path / "floor.xml"})
    model, data = system.mj, mujoco.MjData(system.mj)
    robot, *floor = (model.geom(name).id for name in ("robot/g", "floor/b0", "floor/b1"))
    sides = Sides(system, [robot, *floor], 1e-9)
    union = UnionPair(system, "union", (sides.of(robot), sides.of(floor[0])), [(robot, k) for k in floor], 0.5, 0.0, "rule")

    def nearest(x):
        data.qpos[:3] = x, 0.0, 0.5
        mujoco.mj_kinematics(model, data)
        return union.geoms_among(model, data, ())

    right = nearest(0.3)
    assert right != nearest(-0.3)
    nearest(0.3)
    state = as_mappings(union.get_state())
    assert nearest(0.0) == right
    nearest(-0.3)
    union.set_state(state)
    assert nearest(0.0) == right
    nearest(-0.3)
    with forgetting(UnionPair, "last"):
        union.set_state(state)
    assert nearest(0.0) != right


def test_every_class_is_here():
    """Whatever remembers: here, with the features and those of cones, or with the control laws."""
    known = (
        {kind for _, kind, _ in CASES}
        | {kind.__name__ for kind, _ in FEATURES}
        | {"ContactPair", "NormalSearch", "UnionPair", "RoundOnCone", "RoundConePair", "NearestGenerators"}
    )
    assert set(classes_with_state("ffsm_mj")) == known
