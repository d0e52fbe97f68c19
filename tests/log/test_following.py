"""A camera stands still while the robot is in view, and moves with it from the first event on where it leaves."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.log.drawing import camera_path

TIMES = np.linspace(0.0, 10.0, 11)
VIEW = (np.full(3, -1.0), np.full(3, 3.0))


def boxes(speed: float):
    """A box of edge 1 m that moves along x from the origin."""
    low = np.zeros((len(TIMES), 3))
    low[:, 0] = speed * TIMES
    return np.hstack((low, low + 1.0))


@pytest.mark.parametrize("speed", [0.0, 0.2, -0.1])
def test_a_robot_in_view_is_not_followed(speed):
    """At most 2 m to the right and 1 m to the left: edges of the box on those of the view."""
    assert camera_path(TIMES, boxes(speed), 0.0, VIEW) is None


@pytest.mark.parametrize("speed", [0.21, -0.11])
def test_a_robot_that_leaves_the_view_is_followed(speed):
    path = camera_path(TIMES, boxes(speed), 0.0, VIEW)
    assert path is not None
    np.testing.assert_allclose(path, np.outer(TIMES, [speed, 0.0, 0.0]), atol=1e-15)


def test_the_camera_stands_still_before_the_first_event():
    """The view frames the event at 4 s: only what comes after it counts, and it is seen as framed."""
    path = camera_path(TIMES, boxes(1.0), 4.0, VIEW)
    assert path is not None
    np.testing.assert_allclose(path[:, 0], np.maximum(TIMES - 4.0, 0.0), atol=1e-15)
    assert camera_path(TIMES, boxes(-0.3) + np.array([3.0, 0, 0, 3.0, 0, 0]), 10.0, VIEW) is None


def test_an_event_after_the_last_frame_does_not_matter():
    assert camera_path(TIMES, boxes(0.1), 11.0, VIEW) is None
