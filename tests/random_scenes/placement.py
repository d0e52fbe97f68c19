"""Where things are at the start of a random scene: apart from one another by drawn gaps, and moving towards one another."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

_FAR_M = 9.0
_DISTANCES = 60
"""Most distances that are computed to place one body."""


class Stage:
    """The models of a scene in one MuJoCo model, with what is placed so far; only distances are asked of it."""

    def __init__(self, robot: str, objects: dict[str, str], gravity: np.ndarray) -> None:
        spec = mujoco.MjSpec()
        spec.option.gravity = gravity
        spec.option.ccd_tolerance, spec.option.ccd_iterations = 1e-12, 500
        for name, xml in {"robot": robot, **objects}.items():
            spec.attach(mujoco.MjSpec.from_string(xml), prefix=f"{name}/", frame=spec.worldbody.add_frame(name=f"at {name}"))
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._placed: list[int] = []
        self._moved: dict[str, np.ndarray] = {}

    def set_joints(self, coordinates: dict[str, Any]) -> None:
        """Coordinates by full name."""
        for name, value in coordinates.items():
            start = self.model.joint(name).qposadr[0]
            self.data.qpos[start : start + np.size(value)] = value
        mujoco.mj_kinematics(self.model, self.data)
        for model, shift in self._moved.items():
            self.data.geom_xpos[self.geoms(model)] += shift

    def geoms(self, model: str) -> list[int]:
        return [g for g in range(self.model.ngeom) if self.model.geom(g).name.startswith(f"{model}/")]

    def site(self, name: str) -> np.ndarray:
        """Position of a site."""
        mujoco.mj_kinematics(self.model, self.data)
        return self.data.site(name).xpos.copy()

    def place(self, model: str) -> None:
        """What is a model's is there from now on."""
        self._placed += self.geoms(model)

    def sharpness(self, model: str) -> float:
        """To what the distance to a model's geoms is known, m: worse for ellipsoids and meshes."""
        geoms = {*self.geoms(model), *self._placed}
        vague = {int(mujoco.mjtGeom.mjGEOM_ELLIPSOID), int(mujoco.mjtGeom.mjGEOM_MESH)}
        return 1e-7 if any(int(self.model.geom_type[g]) in vague for g in geoms) else 1e-10

    def gap(self, model: str, shift: np.ndarray) -> float:
        """Least distance of a model's geoms, moved by a vector, from all that is placed."""
        return min(self._distance(mine, other, shift) for mine in self.geoms(model) for other in self._placed)

    def approach_from(self, model: str, start: np.ndarray, way: np.ndarray, gap: float) -> float | None:
        """How far a model can move from ``start`` along a unit vector until its gap is the given one; None: it passes all.

        Each advance by what the gap exceeds the given one is safe, because the gap falls by no more than the advance.
        """
        gone = 0.0
        for _ in range(_DISTANCES):
            left = self.gap(model, start + gone * way) - gap
            if left < 1e-3 * gap + 1e-12:
                return gone
            gone += left
            if gone > _FAR_M:
                return None
        return gone

    def move(self, model: str, shift: np.ndarray) -> None:
        """Move a model's geoms for good."""
        self._moved[model] = shift
        self.data.geom_xpos[self.geoms(model)] += shift

    def _distance(self, mine: int, other: int, shift: np.ndarray) -> float:
        data = self.data
        at = data.geom_xpos[mine].copy()
        data.geom_xpos[mine] += shift
        found = float(mujoco.mj_geomDistance(self.model, data, mine, other, _FAR_M, None))
        data.geom_xpos[mine] = at
        return found
