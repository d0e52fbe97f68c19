"""Lower bounds on gaps: below those of MuJoCo's queries, equal to them over a face, and of all pairs within a reach.

Two pieces that heights part throughout a step are apart at every time of it; those that pass each other are not parted.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.gap_bounds import Instant, PieceBounds, PiecesOfBody, SphereBounds, stay_apart

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


ROD = np.array(((0.0, 0.0, -0.2), (0.0, 0.0, 0.2)))


@pytest.fixture
def rod_and_box():
    """A box and a capsule, each on a free body whose centre of mass is beside it."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option gravity="0 0 0"/><worldbody>
      <body><freejoint/><geom type="box" size="{" ".join(map(str, HALF))}"/><geom pos="0.4 0 0.1" size="0.02"/></body>
      <body><freejoint/><geom type="capsule" size="0.1 0.2"/><geom pos="0 0.3 0" size="0.02"/></body>
      </worldbody></mujoco>""")
    box = PiecesOfBody(
        1,
        np.zeros((1, 3)),
        np.array([np.linalg.norm(HALF)]),
        np.zeros((1, 2, 3)),
        np.array([np.linalg.norm(HALF)]),
        NORMALS[None],
        np.tile(HALF, 2)[None],
    )
    rod = PiecesOfBody(
        2, np.zeros((1, 3)), np.array([0.3]), ROD[None], np.array([0.1]), np.zeros((1, 1, 3)), np.full((1, 1), np.inf)
    )
    return model, mujoco.MjData(model), (box, rod)


def path(model, data, step_s, parts=20):
    """States of a free motion from that in ``data``, in small steps, with the gap of the rod and the box at each."""
    model.opt.timestep = step_s / parts
    states, gaps = [], []
    for _ in range(parts + 1):
        mujoco.mj_forward(model, data)
        states.append(Instant(model, data))
        gaps.append(mujoco.mj_geomDistance(model, data, 0, 2, 10.0, None))
        mujoco.mj_step(model, data)
    return states, gaps


@pytest.mark.parametrize("turned", [False, True])
def test_what_faces_part_from_the_start_of_a_step_to_its_end_is_apart_all_the_time(rod_and_box, rng, turned):
    """Free bodies that turn by half a radian in a step and come near: no contact in between is left out."""
    model, data, pieces = rod_and_box
    one, other = pieces[::-1] if turned else pieces
    parted = passed = near = 0
    for _ in range(1000):
        data.qpos[:] = np.concatenate((np.zeros(3), rng.normal(size=4), rng.normal(0.0, 0.25, 3), rng.normal(size=4)))
        data.qvel[:] = rng.normal(0.0, 1.0, 12) * np.repeat((1.0, 3.0, 1.0, 3.0), 3)
        states, gaps = path(model, data, 0.1)
        excluded = stay_apart(one, 0, other, 0, states[0], states[-1], 1e-7)
        assert not (excluded and min(gaps) < 1e-7)
        parted += excluded
        passed += min(gaps[0], gaps[-1]) > 1e-3 and min(gaps) < 0.0
        near += excluded and min(gaps) < 0.05
    assert parted > 150
    assert passed > 10
    assert near > 10


def test_two_faces_that_slide_along_each_other_are_parted_by_next_to_nothing(rod_and_box):
    """A rod 1e-6 m over a face: parted at rest, not at 1 m/s along it, but again where it leaves faster than the margin."""
    model, data, pieces = rod_and_box

    def excluded(gap, rates):
        data.qpos[:] = (0, 0, 0, 1, 0, 0, 0, HALF[0] + 0.1 + gap, 0, 0, 1, 0, 0, 0)
        data.qvel[:] = (*np.zeros(6), *rates, 0, 0, 0)
        states, _ = path(model, data, 0.01)
        return stay_apart(pieces[0], 0, pieces[1], 0, states[0], states[-1], 1e-7)

    assert excluded(1e-6, (0.0, 0.0, 0.0))
    assert not excluded(1e-6, (0.0, 1.0, 0.0))
    assert excluded(1e-6, (0.2, 1.0, 0.0))
    assert not excluded(0.9e-7, (0.2, 1.0, 0.0))
