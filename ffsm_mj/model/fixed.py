"""Models that are fixed to the world: a wall, a docking port, a test rig. They take part in contacts and never move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.places import Places
from ffsm_mj.model.properties import Pose


@dataclass(frozen=True)
class FixedModel:
    """One model that is fixed to the world.

    Attributes:
        name: Key of the object in the scenario.
        root: Id of the body that represents the ``<worldbody>`` of its file, at its pose.
        bodies: Ids of all its bodies, root first.
    """

    name: str
    root: int
    bodies: tuple[int, ...]


def place(scene: Any, name: str, pose: Pose | None) -> Any:
    """Frame of a scene to which a model is attached: one of the world, or of a body at its pose.

    Args:
        scene: Specification of the scene.
        name: Name of the model.
        pose: Pose at which it is fixed; None if it floats.
    """
    if pose is None:
        return scene.worldbody.add_frame()
    # MuJoCo reserves the body name "world", so the name is free.
    return scene.worldbody.add_body(name=_world(name), pos=pose.position_m, quat=pose.quaternion).add_frame()


def moving_parts(scene: Any, files: Mapping[str, ModelFiles]) -> Iterator[str]:
    """Faults of fixed models: one for each joint, mocap body and actuator.

    Args:
        scene: Specification with all models attached.
        files: Files of each model by its prefix.
    """
    places = Places(scene, files)
    mocap = [body for body in scene.bodies if body.mocap]
    for kind, elements, does in (
        ("joint", scene.joints, "moves"),
        ("body", mocap, "(mocap) moves"),
        ("actuator", scene.actuators, "drives"),
    ):
        for element in elements:
            name = element.name.partition("/")[0]
            if name in files and files[name].pose is not None:
                yield f"{places.of(kind, element.name)} {does} a fixed object; remove it, or write 'fixed: false'"


def weightless(model: Any, files: Mapping[str, ModelFiles]) -> None:
    """Set the masses of fixed bodies in a compiled model to zero, so that sums over bodies leave them out."""
    bodies = [body for name, each in files.items() if each.pose is not None for body in _bodies(model, name)]
    if bodies:
        for numbers in (model.body_mass, model.body_inertia, model.body_subtreemass):
            numbers[bodies] = 0.0
        model.body_subtreemass[0] = model.body_mass.sum()


def fixed_model(model: Any, name: str) -> FixedModel:
    """Index map of one fixed model of a compiled scene."""
    bodies = _bodies(model, name)
    return FixedModel(name, bodies[0], bodies)


def _world(name: str) -> str:
    return f"{name}/world"


def _bodies(model: Any, name: str) -> tuple[int, ...]:
    root = int(model.body(_world(name)).id)
    return tuple(np.flatnonzero(model.body_rootid == root).tolist())
