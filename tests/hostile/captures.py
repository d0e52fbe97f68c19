"""A series of its own of captures: mutated grasps and phases, and mutated logs of a run that took hold and let go."""

from __future__ import annotations

from copy import deepcopy
from random import Random
from typing import Any

from tests.capture.scenes import ARM, BOUNDS, TARGET, TOUCH
from tests.hostile.cases import Case, _commands, case
from tests.hostile.documents import Map, Raw, get, places, put, text
from tests.hostile.log_mutations import log, mutate_log, records, values_of
from tests.hostile.yaml_mutations import mutate_tree, scale_numbers, value

CAPTURES = 18
"""The seed of the series."""

_WORDS = ("grasp", "other", "capture", "release", "end", "robot", "target", "target/handle", "grip", "handle", "hand", "")
_HOLD = {"kind": "pd", "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}


def scenario(when: dict[str, Any]) -> Map:
    """The arm takes hold after some ticks and lets go before the end."""
    return _map(
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
            "impact_pairs": [{"geoms": ["hand", "target/target"], "restitution": 0.5}],
            "captures": {"grasp": {"robot_site": "grip", "object_site": "handle", "when": when}},
            "phases": [
                {"name": "meet", "until": "capture", "arm": ["grasp"], "controller": {"kind": "off"}},
                {"name": "hold", "for_s": 0.02, "controller": _HOLD},
                {"name": "leave", "until": "end", "release": ["grasp"], "controller": {"kind": "off"}},
            ],
        }
    )


def drawn(seed: int, number: int, logs: tuple[bytes, ...]) -> Case:
    """A case of any series; the last log is that of a capture."""
    if seed != CAPTURES:
        return case(seed, number, logs[:-1])
    rng = Random(f"{seed}:{number}")
    return _scenario_case(rng) if rng.random() < 0.75 else _log_case(rng, logs[-1])


def _scenario_case(rng: Random) -> Case:
    tree = scenario(rng.choice((TOUCH, BOUNDS)))
    for _ in range(rng.choice((0, 1, 1, 2))):
        _mutate_grasps(rng, tree)
    if rng.random() < 0.6:
        scale_numbers(rng, tree)
    if rng.random() < 0.2:
        mutate_tree(rng, tree)
    written = text(tree).encode("utf-8", "surrogatepass")
    files = {"scenario.yaml": written, "robot.xml": ARM.encode(), "object.xml": TARGET.encode()}
    return Case("capture", files, _commands(rng, "scenario.yaml"))


def _mutate_grasps(rng: Random, tree: Map) -> None:
    """One mutation of the grasps, or of what phases say of them."""
    sections = [dict(tree.pairs)[name] for name in ("captures", "phases") if name in dict(tree.pairs)]
    found = [place for section in sections for place in places(section)]
    if not found:
        return
    place = rng.choice(found)
    kind = rng.randrange(5)
    if kind == 0:
        container, i = place
        del (container.pairs if isinstance(container, Map) else container)[i : i + 1]
    elif kind == 1:
        put(place, rng.choice(_WORDS))
    elif kind == 2:
        put(place, deepcopy(get(rng.choice(found))))
    elif kind == 3:
        container, i = place
        if isinstance(container, Map):
            container.pairs[i] = (
                rng.choice((*_WORDS[:5], "within", "touch", "arm", "release", "when")),
                container.pairs[i][1],
            )
        else:
            container.insert(i, rng.choice(_WORDS))
    else:
        put(place, Raw(value(rng)))


def _log_case(rng: Random, data: bytes) -> Case:
    """Half of them change what the log says of captures: their records, and the columns that say who holds."""
    if rng.random() < 0.5:
        found = records(data)
        for _ in range(rng.choice((1, 2, 4))):
            values_of(rng, found, "/ffsm/capture", "/ffsm/release", "/ffsm/sample", "/ffsm/phase")
        data = log(found)
    else:
        data = mutate_log(rng, data)
    tables = ("samples", "captures", "capture_impulses", "releases", "near_misses")
    command = rng.choice((("analyze", "run.mcap"), ("analyze", "run.mcap", "--json"), ("export", "run.mcap", "--csv")))
    if command[0] == "export":
        command = (*command, "--table", rng.choice(tables))
    return Case(f"log of a capture: {command[0]}", {"run.mcap": data}, (command,))


def _map(data: Any) -> Any:
    if isinstance(data, dict):
        return Map([(str(key), _map(item)) for key, item in data.items()])
    return [_map(item) for item in data] if isinstance(data, list) else data
