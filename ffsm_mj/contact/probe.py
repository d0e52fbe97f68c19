"""Distance queries of polytopes that are no geoms of a model: a scratch model of two geoms stands for any two pieces.

MuJoCo keeps vertices of meshes in single precision, so what a query of a polytope says is off by 1e-7 of its size: the gap
and the normal are found from it on the support functions, as with any other geom (:mod:`ffsm_mj.contact.normal`). A polytope
is moved to the mean of its vertices for that, which keeps the coordinates short however far out it is.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.normal import ContactNormal, NormalSearch
from ffsm_mj.contact.shape import Part, Shape

_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_CORNERS = "1 1 1  1 -1 -1  -1 1 -1  -1 -1 1"
"""A regular tetrahedron: a mesh needs a volume to be compiled."""


class Probe:
    """Scratch model whose two geoms take the shapes of two pieces.

    Attributes:
        model: The scratch model.
        data: Its data.
    """

    def __init__(self, system: Any, vertices: int) -> None:
        """Compile it.

        Args:
            system: MuJoCo model of the system, whose distance queries are as accurate as those of the probe.
            vertices: Largest number of vertices of a polytope.
        """
        points = np.random.default_rng(0).normal(size=(max(vertices, 4), 3))
        listed = " ".join(map(str, (points / np.linalg.norm(points, axis=1)[:, None]).ravel()))
        meshes = "".join(f'<mesh name="{name}" vertex="{_CORNERS} {listed}"/>' for name in "ab")
        geoms = "".join(f'<geom name="{name}" type="mesh" mesh="{name}"/>' for name in "ab")
        self.model: Any = mujoco.MjModel.from_xml_string(
            f"<mujoco><asset>{meshes}</asset><worldbody>{geoms}</worldbody></mujoco>"
        )
        # By MuJoCo's own tolerance of 1e-6 m, pieces that touch would seem to be apart by more than DISTANCE_QUERY_M.
        self.model.opt.ccd_tolerance, self.model.opt.ccd_iterations = system.opt.ccd_tolerance, system.opt.ccd_iterations
        self.data: Any = mujoco.MjData(self.model)
        # Vertices change from query to query: MuJoCo must look at all of them, not climb along edges that are no more.
        self.model.mesh_graphadr[:] = -1
        self._loaded: list[object] = [None, None]

    def place(self, side: int, model: Any, data: Any, geom: int, part: Part | None) -> None:
        """Give geom ``side`` (0 or 1) the shape and pose of a geom of a model, or of a part of it."""
        scratch, placed = self.model, self.data
        if part is None:
            if self._loaded[side] != geom:
                scratch.geom_type[side], scratch.geom_size[side] = model.geom_type[geom], model.geom_size[geom]
                scratch.geom_rbound[side] = model.geom_rbound[geom]
                self._loaded[side] = geom
            placed.geom_xpos[side], placed.geom_xmat[side] = data.geom_xpos[geom], data.geom_xmat[geom]
            return
        if self._loaded[side] is not part:
            vertices = part.polytope.vertices
            first = int(scratch.mesh_vertadr[side])
            scratch.mesh_vert[first : first + len(vertices)] = vertices - part.centre
            scratch.mesh_vertnum[side], scratch.geom_type[side] = len(vertices), _MESH
            scratch.geom_rbound[side] = part.radius
            self._loaded[side] = part
        rotation: FloatArray = data.xmat[part.body]
        placed.geom_xpos[side] = data.xpos[part.body] + rotation.reshape(3, 3) @ part.centre
        placed.geom_xmat[side] = rotation


class PartSearch(NormalSearch):
    """Gap and normal of a pair of which a side is a part, by queries on a probe; see :class:`NormalSearch`."""

    def __init__(
        self, geoms: tuple[int, int], parts: tuple[Part | None, Part | None], size: float, flush: float, probe: Probe
    ) -> None:
        """Start without an estimate."""
        super().__init__((0, 1), size, flush)
        self._geoms, self._parts, self._probe = geoms, parts, probe

    def distance(self, model: Any, data: Any, limit: float) -> float:
        """Signed distance in m, negative when overlapping; ``limit`` if it is larger."""
        # The search itself asks with the scratch model, which is in place by then.
        if model is not self._probe.model:
            self._place(model, data)
        return super().distance(self._probe.model, self._probe.data, limit)

    def normal(self, model: Any, data: Any, shapes: tuple[Shape, Shape]) -> ContactNormal:
        """Contact normal at the state of both pieces; see :meth:`NormalSearch.normal`."""
        self._place(model, data)
        return super().normal(self._probe.model, self._probe.data, shapes)

    def _place(self, model: Any, data: Any) -> None:
        for side, (geom, part) in enumerate(zip(self._geoms, self._parts, strict=True)):
            self._probe.place(side, model, data, geom, part)
