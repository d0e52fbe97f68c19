"""A scene and its log as the oracle sees them: models as text, numbers of the scenario, columns and records."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from tests.random_scenes.oracle.bodies import Array, Bodies, Place, State, matrix
from tests.random_scenes.oracle.shapes import Shape

SENSED = {
    *("framepos", "framequat", "framexaxis", "frameyaxis", "framezaxis", "framelinvel", "frameangvel"),
    *("gyro", "velocimeter", "jointpos", "jointvel"),
}
"""Sensors whose true values are functions of a state."""
STOPPED = {"rigid": (3, 3), "ball": (3, 0), "hinge": (3, 2), "slide": (2, 3), "cylindrical": (2, 2)}
"""Stopped components of velocity and angular velocity by kind of latch: two are those across the axis."""


def _sensors(text: str) -> Iterator[tuple[str, str, str]]:
    """Name, kind, and site or joint of the sensors of the robot's file that the oracle knows."""
    for each in ElementTree.fromstring(text).findall("sensor/*"):
        if each.tag in SENSED:
            of = each.get("joint") or each.get("objname") or each.get("site")
            yield str(each.get("name")), each.tag, f"robot/{of}"


class LoggedScene:
    """Models, columns and records of a run.

    Args:
        folder: Folder with ``scene.yaml`` and the models.
        run: The run; columns by name, and records, are read.
    """

    def __init__(self, folder: Path, run: Any) -> None:
        self.said = json.loads((folder / "scene.yaml").read_text())
        self.run = run
        names = ["robot", *self.said["objects"]]
        texts = {name: (folder / f"{name}.xml").read_text() for name in names}
        fixed = {name: each["pose"] for name, each in self.said["objects"].items() if each.get("fixed")}
        poses = {name: (pose["position_m"], pose["quaternion"]) for name, pose in fixed.items()}
        roots = {name: ElementTree.fromstring(text) for name, text in texts.items()}
        self._change(roots["robot"], self.said["robot"])
        self.bodies = Bodies(roots, poses)
        for name, (at, quat) in poses.items():
            for cone in self.said["objects"][name].get("cones", ()):
                self.bodies.geoms[f"{name}/{cone['name']}"] = Place(-1, np.array(at), matrix(quat), "cone")
        for model, bodies in self.said.get("model", {}).items():
            for name, changed in bodies.items():
                body = next(each for each in self.bodies.bodies if each.name == f"{model}/{name}")
                body.inertia = body.inertia * (changed["mass_kg"] / body.mass)
                body.mass = changed["mass_kg"]
        self.sensors = list(_sensors(texts["robot"]))
        self.models = [name for name in names if name not in fixed]
        self.rules = {rule["name"]: rule for rule in self.said["contacts"].get("rules", ())}
        start = texts["robot"].index('gravity="') + 9
        self.gravity = np.array([float(x) for x in texts["robot"][start:].split('"')[0].split()])

    @staticmethod
    def _change(robot: Any, said: dict[str, Any]) -> None:
        """What the scenario removes from the robot's file, and flexible drives."""
        for what in said.get("strip", ()):
            for joint in robot.iter("joint"):
                joint.attrib.pop(what, None)
        for name, flex in said.get("joint_flex", {}).items():
            body = next(each for each in robot.iter("body") if any(j.get("name") == name for j in each.findall("joint")))
            joint = body.find("joint")
            joint.set("armature", repr(flex["gear"] ** 2 * flex["rotor_inertia"]))
            spring = {key: joint.get(key) for key in ("type", "axis")}
            spring |= {"name": f"{name}_flex", "stiffness": repr(flex["stiffness"]), "damping": repr(flex["damping"])}
            body.insert(list(body).index(joint) + 1, ElementTree.Element("joint", spring))

    def columns(self, start: str) -> Array:
        """(rows, n) Columns whose names begin so, in their order."""
        return np.array([self.run[key] for key in self.run.keys if key.startswith(start)]).T

    @cached_property
    def times(self) -> Array:
        return np.array(self.run["state.time_s"])

    @cached_property
    def q(self) -> Array:
        return self.columns("state.q_")

    @cached_property
    def v(self) -> Array:
        return self.columns("state.v_")

    @cached_property
    def efforts(self) -> dict[str, Array]:
        """Applied efforts in the rows, by actuator."""
        found = {}
        for name in self.bodies.motors:
            start = f"actuators.{name.replace('/', '_')}_applied_"
            found[name] = self.columns(start)[:, 0]
        return found

    def state(self, row: int) -> State:
        return State(self.bodies, self.q[row], self.v[row])

    def before(self, record: Any) -> State:
        return State(self.bodies, np.array(record.qpos), self.bodies.rates(record.qvel_before))

    def shape(self, state: State, geom: str) -> Shape:
        place = self.bodies.geoms[geom]
        return Shape(place.kind, place.size, *state.place(place))

    def rounding(self, shape: Shape) -> float:
        """To what a shape is known, m: vertices of meshes in single precision, and moved onto planes of their union."""
        return 3e-7 * shape.reach + self.said["contacts"].get("weld_m", 0.0) if shape.kind == "mesh" else 0.0

    def geoms(self, side: str) -> list[str]:
        """Geoms that a rule names: one, or those of a body; none if it names a model."""
        if side in self.bodies.geoms:
            return [side]
        return [
            name
            for name, place in self.bodies.geoms.items()
            if place.body >= 0 and self.bodies.bodies[place.body].name == side
        ]

    def shapes(self, state: State, rule: str) -> Iterator[tuple[Shape, Shape]]:
        """Pairs of shapes that a rule has, without those that a later one takes."""
        names = [*self.rules]
        later = [self.rules[name]["between"] for name in names[names.index(rule) + 1 :]]
        for one, other in product(*map(self.geoms, self.rules[rule]["between"])):
            if not any({one, other} <= {*self.geoms(a), *self.geoms(b)} for a, b in later):
                yield self.shape(state, one), self.shape(state, other)

    @cached_property
    def events(self) -> list[Any]:
        """Records with a configuration, in the order of their times."""
        found = [record for records in self.run.records.values() for record in records if hasattr(record, "qpos")]
        return sorted(found, key=lambda record: record.time_s)

    @cached_property
    def hits(self) -> list[list[Any]]:
        """Impacts of geoms and of joints at limits by event."""
        by_event = defaultdict(list)
        for kind in ("impacts", "limit_impacts"):
            for record in self.run.records.get(kind, ()):
                by_event[record.event].append(record)
        return [by_event[event] for event in sorted(by_event)]

    def grasps_change(self, time_s: float) -> bool:
        """Whether a grasp closes or opens at a time."""
        kinds = ("grasp_impulses", "releases")
        return any(record.time_s == time_s for kind in kinds for record in self.run.records.get(kind, ()))

    def closed(self, time_s: float, *, after: bool = False) -> list[str]:
        """Grasps that are closed just before a time, or after all that happens at it."""
        changes = [(r.time_s, r.event, r) for kind in ("grasp_impulses", "releases") for r in self.run.records.get(kind, ())]
        closed: list[str] = []
        for at, _, record in sorted(changes, key=lambda change: change[:2]):
            if at > time_s or (at == time_s and not after):
                break
            if hasattr(record, "replaces"):
                closed = [name for name in closed if name != record.replaces] + [record.grasp]
            else:
                closed = [name for name in closed if name != record.grasp]
        return closed

    def latch_rows(self, state: State, grasp: str) -> Array:
        """(n, nv) Relative velocities at the object's site that a closed grasp stops."""
        said = self.said["grasps"][grasp]
        robot = self.bodies.sites[f"robot/{said['robot_site']}"]
        thing = self.bodies.sites[said["object_site"]]
        point = state.place(thing)[0]
        linear, angular = (
            b - a for a, b in zip(state.jacobian(robot.body, point), state.jacobian(thing.body, point), strict=True)
        )
        kind = said.get("joint", "rigid")
        if "axis" in said:
            axis = state.place(robot)[1] @ (np.array(said["axis"]) / np.linalg.norm(said["axis"]))
            across = np.linalg.svd(axis[None])[2][1:]
        choose = {3: np.eye(3), 2: across if "axis" in said else None, 0: np.zeros((0, 3))}
        translations, rotations = STOPPED[kind]
        return np.vstack([choose[translations] @ linear, choose[rotations] @ angular])

    def latch_rows_at_site(self, state: State, record: Any) -> Array:
        """(6, nv) Relative twist of the two bodies of a grasp at the object's site."""
        robot, thing = self.bodies.sites[record.robot_site], self.bodies.sites[record.object_site]
        point = state.place(thing)[0]
        pairs = zip(state.jacobian(robot.body, point), state.jacobian(thing.body, point), strict=True)
        return np.vstack([b - a for a, b in pairs])
