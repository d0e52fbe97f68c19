"""Rigid bodies of a scene from the text of its models: kinematics, momenta, energies and equations of motion of our own.

Every degree of freedom has an axis and, if it turns, an anchor; both are carried by a frame that moves. The Jacobian of a
point x of a body has the column axis x (x - anchor), or axis, for each degree of freedom on the way from the world to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Array = np.ndarray
WIDTHS = {"free": (7, 6), "ball": (4, 3), "hinge": (1, 1), "slide": (1, 1)}
"""Numbers of coordinates and of rates by kind of joint."""


def matrix(quat: Any) -> Array:
    """Rotation matrix of a quaternion (w, x, y, z)."""
    return Rotation.from_quat(quat, scalar_first=True).as_matrix()


@dataclass
class Joint:
    name: str
    kind: str
    axis: Array
    at: Array
    q: int
    v: int
    armature: float
    stiffness: float
    rest: float
    damping: float


@dataclass
class Body:
    name: str
    model: str
    parent: int
    at: Array
    turn: Array
    joints: list[Joint] = field(default_factory=list)
    mass: float = 0.0
    centre: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    weight: float = 1.0
    """Share of gravity that acts."""


@dataclass
class Place:
    """What is fixed to a body: a geom or a site; body -1 is the world."""

    body: int
    at: Array
    turn: Array
    kind: str = ""
    size: Array = field(default_factory=lambda: np.zeros(0))


@dataclass
class Motor:
    """An actuator: on a joint (index of its rate; ``root``: to the world), or a unit force and torque at a site."""

    name: str
    rate: int
    root: bool
    site: str
    force: Array
    torque: Array


class Bodies:
    """All models of a scene.

    Args:
        models: Their elements of MJCF, the robot's first, by name.
        poses: Position and quaternion of fixed ones.
    """

    def __init__(self, models: dict[str, Any], poses: dict[str, tuple[Any, Any]]) -> None:
        self.bodies: list[Body] = []
        self.geoms: dict[str, Place] = {}
        self.sites: dict[str, Place] = {}
        self.motors: dict[str, Motor] = {}
        self.joints: dict[str, Joint] = {}
        self.solids: set[str] = set()  # meshes with faces, which are not convex
        self.nq = self.nv = 0
        for model, root in models.items():
            meshes = {m.get("name"): _floats(m, "vertex").reshape(-1, 3) for m in root.iter("mesh")}
            self.solids |= {f"{model}/{m.get('name')}" for m in root.iter("mesh") if m.get("face")}
            at, quat = poses.get(model, ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
            world = root.find("worldbody")
            assert world is not None
            self._read(world, model, -1, np.array(at), matrix(quat), meshes)
            for motor in root.iter("motor"):
                self._read_motor(motor, model)
        self.armature = np.zeros(self.nv)
        for joint in self.joints.values():
            self.armature[joint.v : joint.v + WIDTHS[joint.kind][1]] = joint.armature

    def _read(self, element: Any, model: str, body: int, at: Array, turn: Array, meshes: dict[str | None, Array]) -> None:
        """Geoms, sites and children of a body; ``at`` and ``turn`` place what is in the world."""
        in_world = (at, turn) if body < 0 else (np.zeros(3), np.eye(3))
        for child in element:
            name = f"{model}/{child.get('name')}"
            where = in_world[0] + in_world[1] @ _floats(child, "pos", "0 0 0")
            how = in_world[1] @ matrix(_floats(child, "quat", "1 0 0 0"))
            if child.tag == "geom":
                kind = child.get("type", "sphere")
                if f"{model}/{child.get('mesh')}" in self.solids:
                    kind = "solid"
                size = _floats(child, "size", "0")
                if kind in ("mesh", "solid"):
                    size = meshes[child.get("mesh")].astype(np.float32).astype(float)
                self.geoms[name] = Place(body, where, how, kind, size)
            elif child.tag == "site":
                self.sites[name] = Place(body, where, how)
            elif child.tag == "body":
                made = Body(name, model, body, where, how)
                self.bodies.append(made)
                index = len(self.bodies) - 1
                for joint in [*child.findall("freejoint"), *child.findall("joint")]:
                    self._read_joint(joint, model, made)
                inertial = child.find("inertial")
                made.mass = float(inertial.get("mass"))
                made.centre = _floats(inertial, "pos")
                made.weight = 1.0 - float(child.get("gravcomp", 0.0))
                axes = matrix(_floats(inertial, "quat", "1 0 0 0"))
                made.inertia = axes @ np.diag(_floats(inertial, "diaginertia")) @ axes.T
                self._read(child, model, index, at, turn, meshes)

    def _read_joint(self, element: Any, model: str, body: Body) -> None:
        kind = "free" if element.tag == "freejoint" else element.get("type", "hinge")
        axis = _floats(element, "axis", "0 0 1")
        joint = Joint(
            f"{model}/{element.get('name')}",
            kind,
            axis / np.linalg.norm(axis),
            _floats(element, "pos", "0 0 0"),
            self.nq,
            self.nv,
            *(float(element.get(key, 0.0)) for key in ("armature", "stiffness", "springref", "damping")),
        )
        body.joints.append(joint)
        self.joints[joint.name] = joint
        self.nq, self.nv = self.nq + WIDTHS[kind][0], self.nv + WIDTHS[kind][1]

    def _read_motor(self, element: Any, model: str) -> None:
        gear = _floats(element, "gear", "1 0 0 0 0 0")
        name, joint = f"{model}/{element.get('name')}", element.get("joint")
        rate = -1 if joint is None else self.joints[f"{model}/{joint}"].v
        root = any(body.parent < 0 and f"{model}/{joint}" in [each.name for each in body.joints] for body in self.bodies)
        self.motors[name] = Motor(name, rate, root, f"{model}/{element.get('site')}", gear[:3], gear[3:])

    def rates(self, by_joint: Any) -> Array:
        """Generalised velocity from numbers by joint."""
        v = np.zeros(self.nv)
        for name, values in by_joint.items():
            joint = self.joints[name]
            v[joint.v : joint.v + WIDTHS[joint.kind][1]] = values
        return v

    def of_model(self, model: str) -> tuple[slice, slice]:
        """Coordinates and rates of a model."""
        mine = [joint for name, joint in self.joints.items() if name.startswith(f"{model}/")]
        first, last = mine[0], mine[-1]
        return slice(first.q, last.q + WIDTHS[last.kind][0]), slice(first.v, last.v + WIDTHS[last.kind][1])


class State:
    """Kinematics at coordinates q and rates v."""

    def __init__(self, bodies: Bodies, q: Array, v: Array) -> None:
        self.all, self.q, self.v = bodies, q, v
        n = bodies.nv
        self.axis, self.anchor, self.turns = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, dtype=bool)
        self.axis_rate, self.anchor_rate = np.zeros((n, 3)), np.zeros((n, 3))
        self.at, self.frame, self.chain = [], [], []
        for body in bodies.bodies:
            self._add(body)

    def _add(self, body: Body) -> None:
        root = body.parent < 0
        at, frame = (np.zeros(3), np.eye(3)) if root else (self.at[body.parent], self.frame[body.parent])
        chain = np.zeros(self.all.nv, dtype=bool) if root else self.chain[body.parent].copy()
        at, frame = at + frame @ body.at, frame @ body.turn
        for joint in body.joints:
            q, d = self.q[joint.q : joint.q + WIDTHS[joint.kind][0]], joint.v
            if joint.kind == "slide":
                axis = frame @ joint.axis
                self._moves(d, axis, np.zeros(3), chain, turns=False)
                at = at + axis * q[0]
            elif joint.kind == "hinge":
                axis, anchor = frame @ joint.axis, at + frame @ joint.at
                self._moves(d, axis, anchor, chain, turns=True)
                frame = Rotation.from_rotvec(axis * q[0]).as_matrix() @ frame
                at = anchor - frame @ joint.at
            else:
                if joint.kind == "free":
                    at, frame = q[:3], matrix(q[3:])
                    for k in range(3):
                        self._moves(d + k, np.eye(3)[k], np.zeros(3), chain, turns=False)
                    d, anchor = d + 3, at
                else:
                    anchor = at + frame @ joint.at
                    frame = frame @ matrix(q)
                    at = anchor - frame @ joint.at
                carried = self._carried(chain, anchor)[0]
                turning = self._carried(chain, anchor)[1] + frame @ self.v[d : d + 3]
                for k in range(3):  # these axes are those of the body itself
                    self.axis[d + k], self.anchor[d + k], self.turns[d + k] = frame[:, k], anchor, True
                    self.axis_rate[d + k], self.anchor_rate[d + k] = np.cross(turning, frame[:, k]), carried
                    chain[d + k] = True
        self.at.append(at)
        self.frame.append(frame)
        self.chain.append(chain)

    def _moves(self, d: int, axis: Array, anchor: Array, chain: Array, *, turns: bool) -> None:
        speed, turning = self._carried(chain, anchor)
        self.axis[d], self.anchor[d], self.turns[d] = axis, anchor, turns
        self.axis_rate[d], self.anchor_rate[d] = np.cross(turning, axis), speed
        chain[d] = True

    def _carried(self, chain: Array, point: Array) -> tuple[Array, Array]:
        """Velocity and angular velocity, at a point, of what the degrees of freedom in a chain move."""
        linear, angular = self._rows(chain, point)
        return linear @ self.v, angular @ self.v

    def _rows(self, chain: Array, point: Array) -> tuple[Array, Array]:
        turning = self.axis * (self.turns & chain)[:, None]
        linear = np.cross(turning, point - self.anchor) + self.axis * (~self.turns & chain)[:, None]
        return linear.T, turning.T

    def jacobian(self, body: int, point: Array) -> tuple[Array, Array]:
        """(3, nv) each: of the velocity of a body's point, and of its angular velocity; zero for the world."""
        return self._rows(self.chain[body] if body >= 0 else np.zeros(self.all.nv, dtype=bool), point)

    def place(self, place: Place) -> tuple[Array, Array]:
        """Position and rotation of a geom or site."""
        if place.body < 0:
            return place.at, place.turn
        return self.at[place.body] + self.frame[place.body] @ place.at, self.frame[place.body] @ place.turn

    def moving(self, model: str) -> Iterator[tuple[int, Body, Array, Array, Array, Array]]:
        """Of each body of a model: index, body, mass centre, world inertia, Jacobians at the mass centre."""
        for i, body in enumerate(self.all.bodies):
            if body.model == model:
                centre = self.at[i] + self.frame[i] @ body.centre
                yield i, body, centre, self.frame[i] @ body.inertia @ self.frame[i].T, *self.jacobian(i, centre)

    def momentum(self, model: str) -> Array:
        """P, and L about the world origin."""
        total = np.zeros(6)
        for _, body, centre, inertia, linear, angular in self.moving(model):
            p = body.mass * (linear @ self.v)
            total += [*p, *(np.cross(centre, p) + inertia @ (angular @ self.v))]
        return total

    def kinetic(self, model: str) -> float:
        """Kinetic energy, that of armatures included."""
        v = self.v[(rates := self.all.of_model(model)[1])]
        total = 0.5 * float(v @ (self.all.armature[rates] * v))
        for _, body, _, inertia, linear, angular in self.moving(model):
            speed, turning = linear @ self.v, angular @ self.v
            total += 0.5 * float(body.mass * speed @ speed + turning @ inertia @ turning)
        return total

    def mass_matrix(self) -> Array:
        """(nv, nv), of all models."""
        M = np.diag(self.all.armature)
        for model in dict.fromkeys(body.model for body in self.all.bodies):
            for _, body, _, inertia, linear, angular in self.moving(model):
                M = M + body.mass * linear.T @ linear + angular.T @ inertia @ angular
        return M

    def bias(self, model: str, gravity: Array) -> Array:
        """(nv,) What generalised forces must balance at zero generalised acceleration."""
        total = np.zeros(self.all.nv)
        for i, body, centre, inertia, linear, angular in self.moving(model):
            speed, turning = linear @ self.v, angular @ self.v
            on = self.chain[i]
            turned = self.axis_rate * (self.turns & on)[:, None]
            slid = self.axis_rate * (~self.turns & on)[:, None]
            axes = self.axis * (self.turns & on)[:, None]
            away = np.cross(turned, centre - self.anchor) + np.cross(axes, speed - self.anchor_rate) + slid
            gain, spin = self.v @ away, self.v @ turned
            total += linear.T @ (body.mass * (gain - body.weight * gravity))
            total += angular.T @ (inertia @ spin + np.cross(turning, inertia @ turning))
        return total

    def springs(self, model: str) -> Array:
        """(nv,) Forces of the springs and dampers of joints."""
        force = np.zeros(self.all.nv)
        for joint in self.all.joints.values():
            if joint.name.startswith(f"{model}/") and (joint.stiffness or joint.damping):
                rates = slice(joint.v, joint.v + WIDTHS[joint.kind][1])
                force[rates] = -joint.stiffness * self._stretch(joint) - joint.damping * self.v[rates]
        return force

    def elastic(self, model: str) -> float:
        """Energy of the springs of joints."""
        mine = [joint for joint in self.all.joints.values() if joint.name.startswith(f"{model}/") and joint.stiffness]
        return sum(0.5 * joint.stiffness * float(np.sum(self._stretch(joint) ** 2)) for joint in mine)

    def _stretch(self, joint: Joint) -> Array:
        q = self.q[joint.q : joint.q + WIDTHS[joint.kind][0]]
        return Rotation.from_quat(q, scalar_first=True).as_rotvec() if joint.kind == "ball" else q - joint.rest

    def pushed(self, efforts: dict[str, float]) -> tuple[Array, Array]:
        """(nv,) generalised force of actuators, and (6,) external force and moment about the world origin."""
        force, external = np.zeros(self.all.nv), np.zeros(6)
        for name, effort in efforts.items():
            motor = self.all.motors[name]
            if motor.rate >= 0:
                force[motor.rate] += effort
                if motor.root:  # along the axis, on a line through the base's frame where it is a force
                    push = effort * self.axis[motor.rate]
                    external += [0, 0, 0, *push] if self.turns[motor.rate] else [*push, *np.cross(self.at[0], push)]
                continue
            site = self.all.sites[motor.site]
            at, frame = self.place(site)
            push, twist = effort * frame @ motor.force, effort * frame @ motor.torque
            linear, angular = self.jacobian(site.body, at)
            force += linear.T @ push + angular.T @ twist
            external += [*push, *(twist + np.cross(at, push))]
        return force, external


def _floats(element: Any, key: str, default: str = "") -> Array:
    return np.array([float(x) for x in element.get(key, default).split()])
