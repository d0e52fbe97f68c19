"""MJCF of a scene: for MuJoCo, Basilisk's MJScene and ffsm-mj."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from engine_runs.scene import Body, Scene


def _words(values: Iterable[float]) -> str:
    return " ".join(f"{value:.17g}" for value in values)


def _geom(body: Body, friction: str) -> str:
    if body.half_m is None and not body.radius_m:
        return ""
    shape = f'type="box" size="{_words(body.half_m)}"' if body.half_m else f'type="sphere" size="{body.radius_m}"'
    return f'<geom name="{body.name}" {shape} mass="0" {friction}/>'


def body_xml(scene: Scene, body: Body, geom: str, *, damping: bool = True) -> str:
    """A body with its joint and its children; frames lie in the anchors of joints."""
    origin = np.zeros(3)
    if body.joint is None:
        place, joint = np.array(body.position_m), f'<freejoint name="{body.name}"/>'
        frame = place
    else:
        frame = np.array(body.joint.anchor_m)
        damped = f' damping="{body.joint.damping}"' if damping and body.joint.damping else ""
        joint = f'<joint name="{body.name}" type="{body.joint.kind}" axis="{_words(body.joint.axis)}"{damped}/>'
        if body.joint.parent:
            origin = frame_of(scene.body(body.joint.parent))
        place = frame - origin
    centre = np.array(body.position_m) - frame
    children = "".join(
        body_xml(scene, child, geom, damping=damping)
        for child in scene.bodies
        if child.joint is not None and child.joint.parent == body.name
    )
    return (
        f'<body name="{body.name}" pos="{_words(place)}"><inertial pos="{_words(centre)}" mass="{body.mass_kg}" '
        f'diaginertia="{_words(body.inertia_kg_m2)}"/>{joint}{_geom(body, geom)}{children}</body>'
    )


def frame_of(body: Body) -> np.ndarray:
    """Origin of a body's frame at the start: the anchor of its joint, or its centre of mass."""
    return np.array(body.position_m if body.joint is None else body.joint.anchor_m)


def motors(scene: Scene) -> str:
    """One motor for each joint with an effort."""
    return "".join(f'<motor name="{name}" joint="{name}"/>' for name in scene.efforts)


def whole(scene: Scene, option: str, *, geom: str = "", weld: str | None = None) -> str:
    """One model of all bodies; ``weld`` has the attributes of the weld's constraint."""
    roots = "".join(body_xml(scene, body, geom) for body in scene.bodies if body.joint is None or not body.joint.parent)
    equality = ""
    if scene.weld and weld is not None:
        first, second = scene.weld
        place = np.array(scene.body(second).position_m) - np.array(scene.body(first).position_m)
        equality = f'<equality><weld body1="{first}" body2="{second}" relpose="{_words(place)} 1 0 0 0" {weld}/></equality>'
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="0 0 0" {option}/><worldbody>{roots}</worldbody>'
        f"{equality}<actuator>{motors(scene)}</actuator></mujoco>"
    )
