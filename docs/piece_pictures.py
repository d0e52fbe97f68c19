"""Figures of scenarios whose shapes are pieces: pictures in which every convex piece has a colour of its own, and phases.

MuJoCo's renderer draws the pictures off screen. Without a display it needs ``MUJOCO_GL=egl``, as ``make figures`` sets it:
MuJoCo reads it when it is imported.
"""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from matplotlib.axes import Axes
from PIL import Image

import ffsm_mj

HEIGHT, WIDTH = 900, 1100
GAP = 30
SMALLER = 2
"""Pictures are drawn larger and reduced, which smooths edges."""
GOLDEN = 0.618034
"""Steps of hue: those of neighbours in a list are far apart, and no two of a few hundred are the same."""


def colours(count: int) -> list[tuple[float, float, float, float]]:
    """Colours of some pieces, RGBA."""
    return [(*colorsys.hsv_to_rgb(k * GOLDEN % 1.0, 0.35 + 0.3 * (k % 3) / 2.0, 0.9), 1.0) for k in range(count)]


def model_of(pieces: Sequence[np.ndarray], tints: Sequence[tuple[float, float, float, float]]) -> Any:
    """A model that shows pieces.

    Args:
        pieces: Their vertices, (n, 3) each, m.
        tints: Their colours, RGBA.
    """
    spec = mujoco.MjSpec()
    for k, (vertices, tint) in enumerate(zip(pieces, tints, strict=True)):
        spec.add_mesh(name=f"piece_{k}", uservert=vertices.ravel())
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"piece_{k}", rgba=tint)
    return spec.compile()


def rendered(
    model: Any, data: Any, *, lookat: Sequence[float], distance: float, azimuth: float, elevation: float
) -> np.ndarray:
    """A picture of a model on white, (height, width, 3).

    Args:
        model: MuJoCo model; its geoms of groups 0 to 2 are drawn.
        data: Its data, with current poses.
        lookat: Point in the middle, m.
        distance: Distance of the camera from it, m.
        azimuth: Direction of the view about z, degrees.
        elevation: Its angle above the horizontal, degrees: negative looks down.
    """
    model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH, HEIGHT
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.5, 0.5
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = lookat, distance, azimuth, elevation
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data, camera)
        picture: np.ndarray = renderer.render().copy()
        renderer.enable_segmentation_rendering()
        picture[renderer.render()[:, :, 0] < 0] = 255  # where nothing is drawn
    return picture


def save(pictures: Sequence[np.ndarray], path: Path) -> None:
    """Write pictures side by side as PNG."""
    gap = np.full((HEIGHT, GAP, 3), 255, np.uint8)
    image = Image.fromarray(np.concatenate([part for picture in pictures for part in (picture, gap)][:-1], axis=1))
    image = image.resize((image.width // SMALLER, image.height // SMALLER), Image.Resampling.LANCZOS)
    path.parent.mkdir(parents=True, exist_ok=True)
    image.quantize(256).save(path, optimize=True)


def mark_phases(run: ffsm_mj.Run, every: Sequence[Axes]) -> None:
    """Mark the beginnings of phases by lines in all axes, with their names above the first, on two heights."""
    for k, record in enumerate(run.records["phases"]):
        for axes in every:
            axes.axvline(record.start_s, color="0.6", linewidth=0.7)
        place, above = (record.start_s, 1.0), (2, 2 + 9 * (k % 2))
        every[0].annotate(record.name, place, above, xycoords=("data", "axes fraction"), textcoords="offset points")
