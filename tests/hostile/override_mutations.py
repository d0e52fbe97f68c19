"""Overrides (``-s key=value``) with keys and values that nobody meant."""

from __future__ import annotations

from random import Random
from typing import Any

from tests.hostile.documents import Map, places
from tests.hostile.values import KEYS
from tests.hostile.yaml_mutations import value

_WHOLE = (
    *("=", "a", "", "a=", "=a", "a.b.c=[", "phases.²=3", "phases.99999999999999999999=3", "phases.-1.name=x"),
    *("phases.0=", "phases.=3", "phases..name=x", ".=1", "..=1", "robot=null", "robot.mjcf.x=1", "phases=[[["),
    *("phases.0.controller.kind=!!bool maybe", " =1", "duration_s==3", "duration_s=\n3", "dura\ntion_s=3"),
    *("duration_s=\x1b[31m", "\ud800=1", "name=\udcff", "objects.é.mjcf=x", "\0", "phases.0.name=!!int ''"),
    *("contacts.rules.0=~", "contacts.rules.0.geoms=[a]", "contacts.rules.0.geoms=[[], 3]"),
    *("contacts.rules.0.name='7'", "contacts.rules..name=x", "contacts.rules.x.y=3", "phases.a.b.c=x"),
    *("task=1:2:3", "task.target_m.1=0x_", "initial.joints.base_x=!!float x", "x" * 5000, "a." * 2000 + "b=1"),
    *("phases.٣.name=x", "phases.+1.name=x", "phases.1_0.name=x", "phases.00.name=x", "1=2", "objects.object=[]"),
    *("extends=baseline", "extends=null", "log=3", "impact=[]", "actuators.a=1", "actuators.wheel.kind=!!set {a}"),
    *("robot={}", "name=../../x", "name=" + "n" * 300, "name=''", "description=!!binary aGk=", "name=a/b"),
    *("name=.", "name=latest", "phases=[]", "initial.joints={null: 1}", "initial.rates={1: 2}"),
    *("initial.joints={[1]: 2}", "objects={null: {mjcf: x}}", "actuators={1: {}}", "robot.mjcf=.", "robot.mjcf=''"),
    *("robot.mjcf=/dev/null", "robot.mjcf=scenario.yaml", "robot.mjcf=" + "x" * 300, 'robot.mjcf="\\0"'),
    *('robot.mjcf="\\uDCFF"', 'robot.mjcf="a\\nb"', "robot.mjcf=/dev/zero", "robot.mjcf=object.xml"),
    "objects.object.mjcf=robot.xml",
)


def overrides(rng: Random, tree: Map) -> list[str]:
    """Arguments of one to three overrides of a scenario."""
    found = []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        text = rng.choice(_WHOLE) if rng.random() < 0.3 else f"{_key(rng, tree)}={value(rng)}"
        found += ["-s", text.replace("\0", " ")]  # no argument of a program can hold a NUL
    return found


def _key(rng: Random, tree: Map) -> str:
    """A dotted key that the scenario has, or nearly."""
    place = rng.choice(list(places(tree)))
    parts = _path(tree, place) or ["name"]
    if rng.random() < 0.25:
        parts[rng.randrange(len(parts))] = rng.choice((*KEYS, "99", "-1", "x", "²", str(10**30)))
    if rng.random() < 0.15:
        parts.append(rng.choice(("x", "0", "", "kind", "1")))
    return ".".join(parts)


def _path(node: Any, place: Any) -> list[str] | None:
    container, at = place
    for i, item in enumerate(node.pairs if isinstance(node, Map) else node if isinstance(node, list) else ()):
        name, child = item if isinstance(node, Map) else (str(i), item)
        if node is container and i == at:
            return [name]
        below = _path(child, place)
        if below is not None:
            return [name, *below]
    return None
