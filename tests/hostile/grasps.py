"""A series of its own of grasps: mutated grasps and phases, and mutated logs of a run that took hold and let go."""

from __future__ import annotations

from random import Random
from typing import Any

from tests.contact_models.grasp.scenes import ARM, BOUNDS, TARGET, TOUCH
from tests.hostile.cases import Case, commands, log_case_of
from tests.hostile.documents import Map, text, tree_of
from tests.hostile.yaml_mutations import mutate_tree, mutate_within, scale_numbers

GRASPS = 18
"""The seed of the series."""

_WORDS = ("grasp", "other", "grasp", "release", "end", "robot", "target", "target/handle", "grip", "handle", "hand", "")
_KEYS = (*_WORDS[:5], "within", "touch", "arm", "release", "when", "joint", "axis", "load_limit", "force_N")
_LATCHES: tuple[dict[str, Any], ...] = (
    {},
    {"joint": "ball"},
    {"joint": "hinge", "axis": [0.0, 1.0, 0.0]},
    {"joint": "cylindrical", "axis": [1.0, 0.0, 0.0], "load_limit": {"force_N": 1.0}},
)
_HOLD = {"kind": "pd", "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}


def scenario(when: dict[str, Any], latch: dict[str, Any] | None = None) -> Map:
    """The arm takes hold after some ticks, by a latch with some freedom or none, and lets go before the end."""
    return tree_of(
        {
            "name": "gripped",
            "duration_s": 0.06,
            "time_step_s": 0.001,
            "control_period_s": 0.002,
            "robot": {"mjcf": "robot.xml"},
            "objects": {"target": {"mjcf": "object.xml"}},
            "initial": {
                "joints": {"target/free": [1.05, 0.03, 0.02, 1, 0, 0, 0]},
                "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3], "shoulder": 0.1},
            },
            "contacts": {"rules": [{"between": ["hand", "target/target"], "restitution": 0.5}]},
            "grasps": {"grasp": {"robot_site": "grip", "object_site": "handle", "when": when, **(latch or {})}},
            "phases": [
                {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": {"kind": "off"}},
                {"name": "hold", "for_s": 0.02, "controller": _HOLD},
                {"name": "leave", "until": "end", "release": ["grasp"], "controller": {"kind": "off"}},
            ],
        }
    )


def drawn(number: int, data: bytes) -> Case:
    """A case of the series; a log of a capture is there to be mutated."""
    rng = Random(f"{GRASPS}:{number}")
    if rng.random() < 0.75:
        return _scenario_case(rng)
    topics = "/ffsm/grasp", "/ffsm/release", "/ffsm/sample", "/ffsm/phase"
    tables = "samples", "grasps", "grasp_impulses", "releases", "near_misses"
    return log_case_of(rng, data, "a capture", (0.5, (1, 2, 4)), topics, tables)


def _scenario_case(rng: Random) -> Case:
    tree = scenario(rng.choice((TOUCH, BOUNDS)), rng.choice(_LATCHES))
    for _ in range(rng.choice((0, 1, 1, 2))):
        mutate_within(rng, tree, ("grasps", "phases"), _WORDS, _KEYS)
    if rng.random() < 0.6:
        scale_numbers(rng, tree)
    if rng.random() < 0.2:
        mutate_tree(rng, tree)
    written = text(tree).encode("utf-8", "surrogatepass")
    files = {"scenario.yaml": written, "robot.xml": ARM.encode(), "object.xml": TARGET.encode()}
    return Case("grasp", files, commands(rng, "scenario.yaml"))
