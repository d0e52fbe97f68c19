"""A plane among the pieces of a fixed object, and under a body of pieces: an infinite piece, without a middle."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.contact.unions.judge import sound
from tests.contact.unions.scenes import fixed, free, geoms, on

PLANE = '<geom name="plane" type="plane" size="1 1 0.1" mass="0"/>'
LARGE = geoms((((-9.0, -9.0, -1.0), (9.0, 9.0, 0.0)),), "large")
STEP = geoms((((0.0, -0.5, -0.2), (0.5, 0.5, 0.0)), ((0.5, -0.5, -0.2), (1.0, 0.5, 0.3))))
"""Level with the plane, then a wall on it."""
HALVES = geoms((((-0.1, -0.1, -0.1), (0.0, 0.1, 0.1)), ((0.0, -0.1, -0.1), (0.1, 0.1, 0.1))), "h")
PROUD = geoms((((-0.1, -0.1, -0.1), (0.0, 0.1, 0.1)), ((0.0, -0.1, -0.1 - 5e-10), (0.1, 0.1, 0.1))), "h")
"""The weld moves a face of the second by 5e-10 m: it is no geom any more."""
BODIES = {
    "sphere": '<geom name="s" type="sphere" size="0.1" mass="0"/>',
    "halves": HALVES,
    "rod": '<geom name="r" type="capsule" size="0.1 0.2" zaxis="0 1 0" mass="0"/>',
    "roller": '<geom name="c" type="cylinder" size="0.1 0.2" zaxis="0 1 0" mass="0"/>',
}
START = [-0.6, 0.05, 0.15, 1.0, 0.0, 0.0, 0.0]
RATES = (1.5, 0.0, 0.0, 0.0, 0.3, 0.0)


def run(folder, body, floor, **more):
    return sound(ffsm_mj.run(on(folder, free(body), fixed(floor), joints=START, rates=RATES, **more)))


@pytest.mark.parametrize("body", [pytest.param(b, marks=pytest.mark.long) if b == "roller" else b for b in BODIES])
def test_a_plane_is_a_piece_like_a_large_box(tmp_path, body):
    """It falls on the plane 0.6 m from its origin, slides or rolls over a seam and meets a wall: as over a box of 18 m."""
    one, other = (run(tmp_path, BODIES[body], floor + STEP, restitution=0.3, mu=0.1) for floor in (PLANE, LARGE))
    assert one.impacts[-1].time_s > 0.3
    assert len(one.impacts) == len(other.impacts)
    np.testing.assert_allclose(one.qpos[-1], other.qpos[-1], atol=1e-9)
    np.testing.assert_allclose(one.qvel[-1], other.qvel[-1], atol=1e-9)


@pytest.mark.parametrize("body", [HALVES, PROUD])
def test_a_body_of_pieces_on_a_plane_is_the_whole_body(tmp_path, body):
    whole = geoms((((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)),))
    one, other = (run(tmp_path, each, PLANE, mu=0.1) for each in (body, whole))
    assert one.qpos[-1, 2] == pytest.approx(0.1, abs=1e-9)
    np.testing.assert_allclose(one.qpos[-1], other.qpos[-1], atol=1e-12 if body is HALVES else 1e-8)
