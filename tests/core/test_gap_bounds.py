"""Lower bounds on gaps: below those of MuJoCo's queries, equal to them over a face, and of all pairs within a reach."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.gap_bounds import PieceBounds, PiecesOfBody, SphereBounds

BOXES, HALF = 5, np.array((0.1, 0.15, 0.2))
NORMALS = np.vstack((np.eye(3), -np.eye(3)))


@pytest.fixture
def bodies(rng):
    """Two bodies of boxes and of a ball each, with their pieces."""
    places = [rng.uniform(-0.6, 0.6, (BOXES + 1, 3)) for _ in range(2)]
    size = " ".join(map(str, HALF))
    geoms = [
        "".join(
            f'<geom pos="{" ".join(map(str, p))}" ' + (f'type="box" size="{size}"/>' if i < BOXES else 'size="0.1"/>')
            for i, p in enumerate(body)
        )
        for body in places
    ]
    bodies = "".join(f"<body><freejoint/>{geom}</body>" for geom in geoms)
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    return model, mujoco.MjData(model), [pieces(k + 1, centres) for k, centres in enumerate(places)]


def pieces(body, centres):
    """Boxes, whose spheres and segments are about their centres, and a ball without faces."""
    n = len(centres)
    normals, offsets = np.tile(NORMALS, (n, 1, 1)), np.array([NORMALS @ c + np.tile(HALF, 2) for c in centres])
    offsets[BOXES:] = np.inf  # the ball has no faces
    radii = np.where(np.arange(n) < BOXES, np.linalg.norm(HALF), 0.1)
    return PiecesOfBody(body, centres, radii, np.stack((centres, centres), axis=1), radii, normals, offsets)


def test_no_gap_is_smaller_than_its_bound_and_no_near_pair_is_left_out(bodies, rng):
    """Bounds are the gaps between balls, and of a ball over a face."""
    model, data, (a, b) = bodies
    bounds, among = PieceBounds(a, b), rng.uniform(size=(BOXES + 1, BOXES + 1)) < 0.8
    among[BOXES] = among[:, BOXES] = True
    exact = 0
    for _ in range(50):
        data.qpos[:] = rng.normal(size=model.nq)
        mujoco.mj_forward(model, data)
        reach, without = rng.uniform(0.0, 1.0), int(rng.integers(-1, among.size))
        near = bounds.within(among.view(np.uint8), None, data, reach, without)
        assert near == sorted(near)
        assert all(among.flat[place] and place != without for _, place in near)
        known = {place: bound for bound, place in near}
        for place in set(np.flatnonzero(among)) - {without}:
            i, k = divmod(place, BOXES + 1)
            gap = mujoco.mj_geomDistance(model, data, i, BOXES + 1 + k, 10.0, None)
            assert place in known or gap > reach
            # Queries are off by 1e-9 at most.
            assert place not in known or known[place] <= gap + 1e-9
            exact += place in known and abs(known[place] - gap) < 1e-9
    assert exact > 5


def test_chosen_pairs_alone(bodies, rng):
    model, data, (a, b) = bodies
    data.qpos[:] = rng.normal(size=model.nq)
    mujoco.mj_forward(model, data)
    among = np.ones((BOXES + 1, BOXES + 1), dtype=np.uint8)
    every = PieceBounds(a, b).within(among, None, data, 10.0, -1)
    chosen = rng.choice(among.size, 7, replace=False)
    pairs = np.stack(np.divmod(chosen, BOXES + 1), axis=1)
    assert PieceBounds(a, b).within(among, pairs, data, 10.0, -1) == [one for one in every if one[1] in chosen]


def test_spheres_and_planes(rng):
    """Heights of balls over a plane and distances of balls from each other, which are their gaps."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><geom type="plane" size="1 1 1" euler="20 30 40"/>
      <body><freejoint/><geom size="0.1"/></body><body><freejoint/><geom size="0.2"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    bounds = SphereBounds(np.array([0, 1, 1]), np.array([1, 0, 2]), np.array([0.1, 0.1, 0.3]), np.array([-1.0, 1.0, 0.0]))
    for _ in range(20):
        data.qpos[:] = rng.normal(size=model.nq)
        mujoco.mj_forward(model, data)
        gaps = [mujoco.mj_geomDistance(model, data, *pair, 10.0, None) for pair in ((0, 1), (0, 1), (1, 2))]
        np.testing.assert_allclose(bounds.gaps(data), gaps, rtol=0, atol=1e-9)
