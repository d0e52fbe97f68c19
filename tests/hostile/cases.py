"""One case by its number: the files of a folder, and commands to be given in it. Equal seeds give equal cases."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from tests.hostile.documents import Map, shipped, text
from tests.hostile.log_mutations import log, mutate_log, records, values_of
from tests.hostile.mjcf_mutations import model, mutate_model, xml
from tests.hostile.mjcf_mutations import scale_numbers as scale_model
from tests.hostile.override_mutations import overrides
from tests.hostile.values import words
from tests.hostile.yaml_mutations import mutate_bytes, mutate_tree
from tests.hostile.yaml_mutations import scale_numbers as scale_scenario

Command = tuple[str, ...]
# A run of 60 steps: long enough for a controller, the first rows and the account of them.
_SHORT = ("-s", "duration_s=0.06", "-s", "time_step_s=0.001", "-s", "control_period_s=0.02")
_MODELS = {
    "baseline": ("ffsm_3dof.xml", "box_1m.xml"),
    "coasting": ("ffsm_3dof.xml", "box_1m.xml"),
    "free-flying": ("ffsm_3dof.xml", "box_1m.xml"),
    "free-flying-hardware": ("ffsm_3dof_hardware.xml", "box_1m.xml"),
    "spatial": ("spacecraft_7dof.xml", "satellite_defunct.xml"),
}

_BODIES: dict[str, tuple[str, str, str, str, list[float]]] = {
    "coasting": ("base", "object", "box", "box", [0.5, 0.4, 0.5]),
    "spatial": ("bus", "satellite", "satellite", "nozzle", [0.12, 0.09]),
}
"""A body of the robot, an object with a body and a geom of it, and its size."""


@dataclass(frozen=True)
class Case:
    """What is written into an empty folder, and the commands given there, until one fails.

    Attributes:
        kind: What is hostile about it.
        files: Content by name; a name that ends in a slash is a folder.
        commands: Arguments of ``ffsm``.
        folders: Empty folders.
        links: Symbolic links, name and where it leads; nothing may be written there.
    """

    kind: str
    files: dict[str, bytes]
    commands: tuple[Command, ...]
    folders: tuple[str, ...] = field(default=())
    links: tuple[tuple[str, str], ...] = field(default=())


def case(seed: int, number: int, logs: tuple[bytes, ...]) -> Case:
    """A case.

    Args:
        seed: Of the whole series.
        number: Of the case.
        logs: Logs of whole runs, to be mutated.
    """
    rng = Random(f"{seed}:{number}")
    kinds, weights = zip(*_KINDS, strict=True)
    kind: Callable[[Random, tuple[bytes, ...]], Case] = rng.choices(kinds, weights)[0]
    return kind(rng, logs)


def commands(rng: Random, scenario: str, more: list[str] | tuple[str, ...] = ()) -> tuple[Command, ...]:
    """A scenario is checked and run for a short time."""
    out = () if rng.random() < 0.1 else ("--out", "out")
    return ("check", scenario, *more), ("run", scenario, *more, *_SHORT, "--no-rerun", *out)


@cache
def _scenario(name: str) -> Map:
    return shipped(name)


@cache
def model_text(name: str) -> bytes:
    """Of a shipped model, in one file."""
    return xml(model(name))


def _tree(rng: Random) -> tuple[str, Map]:
    """A scenario with its models named as a case's folder holds them."""
    name = rng.choice(("baseline", "baseline", "coasting", "free-flying", "free-flying-hardware", "spatial"))
    tree = deepcopy(_scenario(name))
    models = (
        Map([("mjcf", "robot.xml")]),
        Map([(("satellite" if name == "spatial" else "object"), Map([("mjcf", "object.xml")]))]),
    )
    if name in ("baseline", "spatial"):
        tree.pairs = [(k, {"robot": models[0], "objects": models[1]}.get(k, v)) for k, v in tree.pairs]
    else:
        tree.pairs = [(k, v) for k, v in tree.pairs if k != "robot"] + [("robot", models[0]), ("objects", models[1])]
        tree.pairs = [(k, f"{Path(v).stem}" if k == "extends" else v) for k, v in tree.pairs]
    tree.pairs += _properties(name)
    return name, tree


def _properties(name: str) -> list[tuple[str, Map]]:
    """Properties of bodies that some of the scenarios give, and what their control laws believe."""
    if name not in _BODIES:
        return []
    base, thing, body, geom, size = _BODIES[name]
    weighs = [
        ("mass_kg", 7.0),
        ("inertia_kg_m2", [3.0, 4.0, 5.0, 0.1, 0.0, -0.2]),
        ("centre_of_mass_m", [0.01, -0.02, 0.03]),
    ]
    sized = [*weighs, ("geoms", Map([(geom, Map([("size_m", size)]))]))]
    model = Map([("robot", Map([(base, Map([("mass_kg", 60.0)]))])), (thing, Map([(body, Map(sized))]))])
    return [("model", model), ("controller_model", Map([(thing, Map([(body, Map([("mass_kg", 8.0)]))]))]))]


def _files(name: str, scenario: bytes) -> dict[str, bytes]:
    robot, target = _MODELS[name]
    return {"scenario.yaml": scenario, "robot.xml": model_text(robot), "object.xml": model_text(target)}


def _scenario_case(rng: Random, _: Any) -> Case:
    name, tree = _tree(rng)
    mutate_tree(rng, tree)
    written = text(tree).encode("utf-8", "surrogatepass")
    return Case("scenario", _files(name, written), commands(rng, "scenario.yaml"))


def _scenario_bytes(rng: Random, _: Any) -> Case:
    name, tree = _tree(rng)
    return Case("scenario bytes", _files(name, mutate_bytes(rng, text(tree).encode())), commands(rng, "scenario.yaml"))


def _extends_case(rng: Random, _: Any) -> Case:
    """A scenario on top of a mutated one, or of itself."""
    name, tree = _tree(rng)
    mutate_tree(rng, tree)
    parent = rng.choice(
        ("parent.yaml", "./parent.yaml", "scenario.yaml", "baseline", "nothing", "..", ".", "/", "a\0b", "é.yaml")
    )
    child = Map(
        [("extends", parent), ("name", "child"), ("phases", [Map([("name", rng.choice(("approach", "coast", "x")))])])]
    )
    mutate_tree(rng, child)
    files = _files(name, text(child).encode("utf-8", "surrogatepass"))
    files["parent.yaml"] = text(tree).encode("utf-8", "surrogatepass")
    return Case("extends", files, commands(rng, "scenario.yaml"))


def _model_case(rng: Random, _: Any) -> Case:
    name, tree = _tree(rng)
    if rng.random() < 0.3:
        tree.pairs.append(("conservative", False))
    files = _files(name, text(tree).encode())
    for which in rng.choice((("robot.xml",), ("object.xml",), ("robot.xml", "object.xml"))):
        root = deepcopy(model(_MODELS[name][which == "object.xml"]))
        mutate_model(rng, root)
        files[which] = xml(root)
    return Case("model", files, commands(rng, "scenario.yaml"))


def _numbers_case(rng: Random, _: Any) -> Case:
    """Numbers out of all proportion, in scenario and models: what passes ``check`` must run, or end as it should."""
    name, tree = _tree(rng)
    scale_scenario(rng, tree)
    if rng.random() < 0.3:
        tree.pairs.append(("conservative", False))
    files = _files(name, text(tree).encode())
    for which, source in zip(("robot.xml", "object.xml"), _MODELS[name], strict=True):
        root = deepcopy(model(source))
        if rng.random() < 0.6:
            scale_model(rng, root)
        files[which] = xml(root)
    return Case("numbers", files, commands(rng, "scenario.yaml"))


def _model_bytes(rng: Random, _: Any) -> Case:
    name, tree = _tree(rng)
    files = _files(name, text(tree).encode())
    which = rng.choice(("robot.xml", "object.xml"))
    files[which] = mutate_bytes(rng, files[which])
    return Case("model bytes", files, commands(rng, "scenario.yaml"))


def _override_case(rng: Random, _: Any) -> Case:
    name, tree = _tree(rng)
    return Case("override", _files(name, text(tree).encode()), commands(rng, "scenario.yaml", overrides(rng, tree)))


_PATHS = (
    *("", ".", "..", "/", "nothing.yaml", "x" * 300 + ".yaml", "x" * 5000, "a\nb.yaml", "é.yaml", "\udcff.yaml"),
    *("folder", "folder.yaml"),
)
_MORE_PATHS = (
    *words("scenario.yaml/x robot.xml scenario.yaml basline /dev/null /dev/full logs/latest"),
    *("~", "*", "{a}", "\x1b[31m"),
)
_NAMES = (
    *("\udcff.yaml", "a\nb.yaml", "é.yaml", "with space.yaml", "a:1:2.yaml", "-.yaml", "x" * 200 + ".yaml"),
    *("noending", "日本.yaml"),
)
_MODEL_NAMES = (
    *("\udcff.xml", "a\nb.xml", "é.xml", "a b.xml"),
    *words("a.urdf a.mjb a.txt a a.XML a.usd a.obj"),
    "x" * 200 + ".xml",
)


def _paths_case(rng: Random, _: Any) -> Case:
    """Files that are not there, are folders, or have names that are hard to print."""
    name, tree = _tree(rng)
    files = _files(name, text(tree).encode())
    kind = rng.randrange(4)
    scenario = "scenario.yaml"
    if kind == 0:
        scenario = rng.choice(_PATHS + _MORE_PATHS)
    elif kind == 1:
        scenario = rng.choice(_NAMES)
        files[scenario] = files.pop("scenario.yaml") if rng.random() < 0.6 else b"name: [\n"
    elif kind == 2:
        moved = rng.choice(_MODEL_NAMES)
        files[moved] = files.pop("robot.xml") if rng.random() < 0.6 else b"<mujoco><worldbody><x/></worldbody></mujoco>"
        tree.pairs = [(k, Map([("mjcf", moved)]) if k == "robot" else v) for k, v in tree.pairs]
        files["scenario.yaml"] = text(tree).encode()
    else:
        out = rng.choice(
            (*_PATHS, "scenario.yaml", "/dev/null", "/dev/full/x", "robot.xml/x", "out/" * 500, "/proc/x", "out")
        )
        # A series may run with every right: where that could really be written, it is asked for somewhere else.
        command = ("run", "scenario.yaml", *_SHORT, "--no-rerun", "--out", "/proc" if out == "/" else out)
        return Case("path", files, (command,), ("folder", "folder.yaml"))
    return Case("path", files, commands(rng, scenario), ("folder", "folder.yaml"))


def _log_case(rng: Random, logs: tuple[bytes, ...]) -> Case:
    data = mutate_log(rng, rng.choice(logs))
    kind = rng.random()
    if kind < 0.7:
        command: Command = ("analyze", "run.mcap", *rng.choice(((), (), ("--json",), ("--tolerance", "1e-6"))))
    elif kind < 0.94:
        table = rng.choice(("samples", "impacts", "phases", "checks"))
        command = ("export", "run.mcap", "--csv", "--table", table)
    else:
        command = ("export", "run.mcap", "--gif", "--fps", "1", "--speed", "1")
    return Case(f"log: {command[0]}{' --gif' if '--gif' in command else ''}", {"run.mcap": data}, (command,))


def log_case_of(
    rng: Random,
    data: bytes,
    what: str,
    changed: tuple[float, tuple[int, ...]],
    topics: tuple[str, ...],
    tables: tuple[str, ...],
) -> Case:
    """A log of a subject: a share of the cases changes so many values of some topics, the others anything."""
    share, counts = changed
    if rng.random() < share:
        found = records(data)
        for _ in range(rng.choice(counts)):
            values_of(rng, found, *topics)
        data = log(found)
    else:
        data = mutate_log(rng, data)
    command = rng.choice((("analyze", "run.mcap"), ("analyze", "run.mcap", "--json"), ("export", "run.mcap", "--csv")))
    if command[0] == "export":
        command = (*command, "--table", rng.choice(tables))
    return Case(f"log of {what}: {command[0]}", {"run.mcap": data}, (command,))


_KINDS: tuple[tuple[Callable[[Random, Any], Case], int], ...] = (
    (_scenario_case, 30),
    (_scenario_bytes, 6),
    (_extends_case, 6),
    (_model_case, 25),
    (_numbers_case, 12),
    (_model_bytes, 6),
    (_override_case, 14),
    (_paths_case, 4),
    (_log_case, 8),
)
