"""Images of a simulation, rendered offscreen by MuJoCo."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.errors import FfsmError, described, unknown_name

_MODULES = {"egl": "mujoco.egl", "osmesa": "mujoco.osmesa", "glfw": "mujoco.glfw", "cgl": "mujoco.cgl"}
_AMBIENT, _DIFFUSE = 0.35, 0.6
"""Light from the camera: models in space have no lamps of their own."""
_DISTANCE = 0.9
"""Distance of the camera over the diagonal of the scene."""


class RenderError(FfsmError):
    """No image can be rendered here; the message says what is needed."""


class Camera:
    """Renders a scene offscreen. All calls must come from one thread; :meth:`close` must follow."""

    def __init__(self, model: Any, data: Any, width: int, height: int, camera: str | int) -> None:
        """Create an OpenGL context.

        Args:
            model: MuJoCo model; lights and the size of its offscreen buffer are set.
            data: Its data.
            width: Width of images, pixels.
            height: Height of images, pixels.
            camera: Name or id of a camera of the model; -1: a camera that frames the scene as it is now.

        Raises:
            RenderError: There is no OpenGL, or no such camera.
        """
        self._model, self._camera = model, _camera(model, data, camera)
        visual = model.vis.global_
        visual.offwidth, visual.offheight = max(visual.offwidth, width), max(visual.offheight, height)
        model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = _AMBIENT, _DIFFUSE
        self._context = _context(width, height)
        self._context.make_current()
        self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        self._scene, self._option = mujoco.MjvScene(model, maxgeom=10_000), mujoco.MjvOption()
        self._frame = mujoco.MjrRect(0, 0, width, height)

    def image(self, data: Any) -> npt.NDArray[np.uint8]:
        """The scene now, RGB, (height, width, 3), a new array."""
        self._context.make_current()
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._option, None, self._camera, everything, self._scene)
        mujoco.mjr_render(self._frame, self._scene, self._renderer)
        image = np.empty((self._frame.height, self._frame.width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, self._frame, self._renderer)
        return image[::-1].copy()

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.free()
        self._context.free()


def _camera(model: Any, data: Any, camera: str | int) -> Any:
    view = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, view)
    radii = model.geom_rbound[:, None]
    low, high = (data.geom_xpos - radii).min(axis=0), (data.geom_xpos + radii).max(axis=0)
    view.lookat[:], view.distance = (low + high) / 2, _DISTANCE * float(np.linalg.norm(high - low))
    names = [model.camera(i).name for i in range(model.ncam)]
    if isinstance(camera, str):
        matches = [i for i, name in enumerate(names) if camera in (name, name.partition("/")[2])]
        if len(matches) != 1:
            raise RenderError(unknown_name("camera", camera, names))
        camera = matches[0]
    if camera >= model.ncam:
        raise RenderError(f"camera {camera}: the models have {model.ncam} cameras")
    if camera >= 0:
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
    return view


def _context(width: int, height: int) -> Any:
    """An OpenGL context by ``MUJOCO_GL``; without it EGL where Linux has no display, otherwise a hidden window."""
    headless = sys.platform == "linux" and not os.environ.get("DISPLAY")
    backend = os.environ.get("MUJOCO_GL", "").lower() or ("egl" if headless else "glfw")
    try:
        if backend not in _MODULES:
            raise RuntimeError(f"allowed: {', '.join(_MODULES)}")
        return import_module(_MODULES[backend]).GLContext(width, height)
    except Exception as error:
        raise RenderError(
            f"render_mode 'rgb_array' needs OpenGL, and MUJOCO_GL={backend} does not give it ({described(error)}); install "
            "a GPU driver with EGL, or Mesa's (libegl1), for MUJOCO_GL=egl, or libosmesa6 for MUJOCO_GL=osmesa; "
            "render_mode 'rerun' needs none of it"
        ) from error
