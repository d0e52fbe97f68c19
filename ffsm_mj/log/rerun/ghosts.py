"""Ghosts in a recording: floating bodies where the control law takes them to be, as wireframes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import rerun as rr

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.drawing import DrawnShape, Poser, shapes
from ffsm_mj.log.palette import GHOST
from ffsm_mj.log.rerun.scene import body_path, primitive
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import Layout, coordinate_keys, identifier

_OPACITY = 170


class Ghosts:
    """Sends the estimated poses of floating robots and objects with all their bodies; nothing without an estimate."""

    def __init__(self, recording: rr.RecordingStream, system: System, layout: Layout) -> None:
        """Log the wireframes of the geoms."""
        self._system = system
        keys = [key.replace("state.", "estimate.", 1) for key in coordinate_keys(system.joints.values())]
        floating = [tree for tree in system.trees if tree.joints[0].kind == "free"]
        self._bodies = [body for tree in floating for body in tree.bodies] if set(keys) <= set(layout.index) else []
        if not self._bodies:
            return
        self._coordinates, self._poser = layout.places(keys), Poser(system.mj)
        for shape in shapes(system):
            if shape.body in self._bodies:
                recording.log(f"{self._path(shape.body)}/{identifier(shape.name)}", _wireframe(shape), static=True)
        for tree in floating:
            text = rr.Points3D(
                [np.zeros(3)], colors=[GHOST], radii=[0.0], labels=[f"estimate of {tree.name}"], show_labels=True
            )
            recording.log(f"{self._path(tree.root)}/name", text, static=True)

    def _path(self, body: int) -> str:
        return body_path(self._system, body).replace("world/", "world/estimate/", 1)

    def send(self, rows: FloatArray, send: Callable[[str, Any], None]) -> None:
        """Send the poses of some rows, (n, number of signals); ``send`` takes an entity and its columns."""
        if not self._bodies:
            return
        positions, quaternions = self._poser.poses(rows[:, self._coordinates])
        for body in self._bodies:
            turned = np.roll(quaternions[:, body], -1, axis=-1)  # xyzw
            send(self._path(body), rr.Transform3D.columns(translation=positions[:, body], quaternion=turned))


def _wireframe(shape: DrawnShape) -> Any:
    """Edges of a shape; of a mesh those of its bounding box, as meshes have no wireframe in the viewer."""
    return primitive(shape, (*GHOST, _OPACITY), "majorwireframe")
