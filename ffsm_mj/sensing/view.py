"""What a sensor sees: whether what it measures is in its field of view, and not hidden."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.sensing.sensor import Sensor

_AXES = {"x": (0, 1.0), "y": (1, 1.0), "z": (2, 1.0), "-x": (0, -1.0), "-y": (1, -1.0), "-z": (2, -1.0)}
_POSITIONS = {
    int(mujoco.mjtObj.mjOBJ_BODY): ("xipos", None),
    int(mujoco.mjtObj.mjOBJ_XBODY): ("xpos", None),
    int(mujoco.mjtObj.mjOBJ_GEOM): ("geom_xpos", "geom_bodyid"),
    int(mujoco.mjtObj.mjOBJ_SITE): ("site_xpos", "site_bodyid"),
    int(mujoco.mjtObj.mjOBJ_CAMERA): ("cam_xpos", "cam_bodyid"),
}
"""Array of positions of each type of object that a frame sensor measures, and array of its bodies."""


class FieldOfView:
    """Field of view of a sensor in one model."""

    def __init__(self, model: Any, sensor: Sensor, site: str) -> None:
        """Bind to a model; ``site`` is the full name of the site at the apex."""
        assert sensor.field_of_view is not None
        self._model, self._occlusion = model, sensor.occlusion
        self._site = int(model.site(site).id)
        self._axis, self._sign = _AXES[sensor.field_of_view.axis]
        self._cosine = math.cos(sensor.field_of_view.half_angle_rad)
        number = int(model.sensor(sensor.name).id)
        self._target = int(model.sensor_objid[number])
        self._positions, bodies = _POSITIONS[int(model.sensor_objtype[number])]
        self._body = int(getattr(model, bodies)[self._target]) if bodies else self._target

    def shows(self, data: Any) -> bool:
        """Whether the target is in view at the state in ``data``."""
        apex = data.site_xpos[self._site]
        axis = self._sign * data.site_xmat[self._site].reshape(3, 3)[:, self._axis]
        line = getattr(data, self._positions)[self._target] - apex
        length = math.hypot(*line.tolist())
        if float(line.dot(axis)) < self._cosine * length:
            return False
        return not (self._occlusion and length > 0.0 and self._hidden(data, apex, line / length, length))

    def _hidden(self, data: Any, apex: FloatArray, direction: FloatArray, length: float) -> bool:
        """Whether a geom of a body other than the target's and the sensor's own is on the line of sight."""
        site_body, start, hit_geom = int(self._model.site_bodyid[self._site]), apex.copy(), np.zeros(1, dtype=np.int32)
        while length > 0.0:
            at = mujoco.mj_ray(self._model, data, start, direction, None, 1, site_body, hit_geom, None)
            if at < 0.0 or at >= length:
                return False
            if int(self._model.geom_bodyid[hit_geom[0]]) != self._body:
                return True
            # The target's own surface does not hide it: look on behind.
            step = at + 1e-9 * (1.0 + at)
            start, length = start + step * direction, length - step
        return False
