"""Path of a camera that follows the robot where it leaves the view."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import System

View = tuple[FloatArray, FloatArray]
"""Lower and upper corner of the box that a view frames, (3,) each, m."""


def robot_boxes(system: System, positions: FloatArray) -> FloatArray:
    """Lower, then upper corners of the boxes around the frames of the robot's bodies in world axes, (n, 6), m.

    Args:
        system: Robot and objects.
        positions: World positions of all bodies, (n, nbody, 3), m.
    """
    robot = positions[:, list(system.robot.bodies)]
    return np.hstack((robot.min(axis=1), robot.max(axis=1)))


def camera_path(times: FloatArray, boxes: FloatArray, first_s: float, view: View) -> FloatArray | None:
    """Displacements of a camera, (n, 3), m; None if the robot stays in view.

    They are those of the middle of the robot since the first event. They are zero before it: the camera stands still until
    then, wherever the viewer begins.

    Args:
        times: Times, (n,), s.
        boxes: Boxes around the robot at these times, (n, 6), m.
        first_s: Time of the first event, at which the view frames everything; zero without events.
        view: What the view frames.
    """
    low, high = view
    first = min(int(np.searchsorted(times, first_s)), len(times) - 1)
    if (boxes[first:, :3] >= low).all() and (boxes[first:, 3:] <= high).all():
        return None
    middles = 0.5 * (boxes[:, :3] + boxes[:, 3:])
    middles[:first] = middles[first]
    return np.asarray(middles - middles[first])
