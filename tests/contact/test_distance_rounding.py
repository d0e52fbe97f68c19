"""Logged gaps are known to rounding, for all pairs of shapes: distance queries are not, where a surface is curved."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj._core.shapes import separation
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.probe import PartSearch, Probe
from ffsm_mj.contact.shape import Part, Shape
from ffsm_mj.polytope import box
from ffsm_mj.tolerances import DISTANCE_QUERY_M
from tests.contact.test_geometry import PAIRS, shape, support
from tests.scenes import scene

OTHER = [0.5, 0.1, 0.1, 0.6, 0.0, 0.8, 0.0]
"""Coordinates of the other body, m and a quaternion."""
ROUNDING_M = 2e-15
"""A few units in the last place of coordinates of 1 m, in sums of some ten terms."""


def turned(model, data, qpos):
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)


@pytest.mark.long
@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_a_gap_is_known_to_rounding(tmp_path, a, b):
    """One unit in the last place of the poses changes it by rounding, and no direction has a larger separation."""
    prepared = prepare(scene(tmp_path, shape(a), {"other": shape(b)}))
    model, rng = prepared.system.mj, np.random.default_rng(11)
    data, pair = mujoco.MjData(model), ContactPair(prepared.system, "pair", "robot/g", "other/g", 1.0)
    for gap_m in (1e-5, 1e-3, 0.1, 0.5):
        poses = rng.normal(size=(2, 7))
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1)[:, None]
        poses[1, :3] = poses[0, :3] + rng.normal(size=3)
        for _ in range(20):  # b moves along the normal until the gap is right
            turned(model, data, poses.ravel())
            near = pair.proximity(model, data)
            if abs(near.gap - gap_m) < 1e-3 * gap_m:
                break
            poses[1, :3] -= (near.gap - gap_m) * near.normal
        found = []
        for _ in range(5):
            turned(model, data, poses.ravel() + np.spacing(np.abs(poses.ravel())) * rng.integers(-1, 2, size=14))
            query = pair.gap(model, data, 10.0)
            found.append(pair.gap_to_rounding(model, data, query))
            assert abs(query - found[-1]) <= DISTANCE_QUERY_M
        assert np.ptp(found) <= ROUNDING_M
        for size in (0.0, 1e-6, 1e-4, 1e-2):
            direction = near.normal + size * rng.normal(size=3)
            direction /= np.linalg.norm(direction)
            ends = (
                support(name, model, data, id_, way * direction)
                for name, id_, way in zip((a, b), pair.ids, (1, -1), strict=True)
            )
            assert -sum(ends) <= found[-1] + ROUNDING_M


@pytest.mark.parametrize("kind", ["ellipsoid", "cylinder", "capsule"])
def test_a_query_of_a_part_is_as_exact_as_of_a_geom(tmp_path, kind):
    """What touches within DISTANCE_QUERY_M is found by it: queries of 1e-6 m, MuJoCo's own tolerance, miss contacts."""
    system = prepare(scene(tmp_path, shape(kind), {"other": shape("box")})).system
    model, data, rng = system.mj, mujoco.MjData(system.mj), np.random.default_rng(3)
    of_box = box(np.array([0.1, 0.15, 0.2]), np.zeros(3), np.eye(3))
    part = Part.of(int(model.body("other/b").id), of_box)
    ids = int(model.geom("robot/g").id), int(model.geom("other/g").id)
    search = PartSearch(ids, (None, part), 0.1, 0.0, Probe(model, len(of_box.vertices)))
    for _ in range(20):
        poses = rng.normal(size=(2, 7))
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1)[:, None]
        for _ in range(20):  # the part moves along the normal until it touches
            turned(model, data, poses.ravel())
            shapes = Shape(model, data, ids[0]), Shape(model, data, ids[1], part)
            gap = separation(*shapes, normal := search.normal(model, data, shapes).normal)
            if abs(gap) < DISTANCE_QUERY_M:
                break
            poses[1, :3] -= gap * normal
        assert abs(search.distance(model, data, 1.0) - gap) <= DISTANCE_QUERY_M


def test_the_logged_gap_of_a_rule_is_known_to_rounding(tmp_path):
    """The query for the nearest pair is wrong by 2.8e-12 m at these poses."""
    egg = shape("ellipsoid").replace('size="0.1 0.2 0.15"', 'size="0.35 0.04 0.15"')
    eggs = egg.replace("</body>", '<geom name="h" type="ellipsoid" size="0.1 0.3 0.2" pos="0.5 0.3 0.2" mass="0"/></body>')
    path = scene(
        tmp_path,
        egg,
        {"other": eggs},
        initial={"joints": {"other/free": OTHER}},
        contacts={"rules": [{"between": ["robot/g", "other"]}]},
        duration_s=0.02,
    )
    run, system = ffsm_mj.run(path), prepare(path).system
    data = mujoco.MjData(system.mj)
    joints = system.mj.joint("other/free").qposadr[0]
    data.qpos[joints : joints + 7] = OTHER
    turned(system.mj, data, data.qpos)
    pairs = [ContactPair(system, name, "robot/g", f"other/{name}", 1.0) for name in ("g", "h")]
    queries = [pair.gap(system.mj, data, 10.0) for pair in pairs]
    gaps = [pair.proximity(system.mj, data).gap for pair in pairs]
    (column,) = [key for key in run.log.header.layout.keys if key.endswith("_gap_m")]
    assert run.log.column(column)[0] == pytest.approx(min(gaps), abs=ROUNDING_M)
    assert abs(min(queries) - min(gaps)) > 1e-12
