"""Boxes near a place and pairs of boxes near each other, against all of them one by one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ffsm_mj._core.boxes import BoxTree


def random_boxes(rng, count: int):
    centres, halves = rng.normal(size=(count, 3)), rng.uniform(0.0, 0.2, (count, 3))
    return np.stack((centres - halves, centres + halves), axis=1)


def distance(one, other) -> float:
    """Distance of two boxes along the axes, m."""
    return float(np.linalg.norm(np.maximum(np.maximum(one[0] - other[1], other[0] - one[1]), 0.0)))


def around(box, rotation, position):
    """The box along the axes around the corners of a box that is turned and moved."""
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    turned = corners @ rotation.T + position
    return np.stack((turned.min(axis=0), turned.max(axis=0)))


@pytest.mark.parametrize("count", [1, 2, 15, 16, 17, 33, 200])
def test_near(count):
    rng = np.random.default_rng(count)
    boxes = random_boxes(rng, count)
    tree = BoxTree(boxes)
    np.testing.assert_array_equal(tree.bounds, [boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    seen = 0
    for _ in range(30):
        query, reach = random_boxes(rng, 1)[0], rng.uniform(0.0, 0.5)
        expected = [k for k in range(count) if distance(boxes[k], query) <= reach]
        assert tree.near(*query, reach) == expected
        seen += len(expected)
    assert seen or count < 15


@pytest.mark.parametrize(("count", "others"), [(1, 1), (1, 40), (16, 17), (50, 33)])
def test_pairs(count, others):
    rng = np.random.default_rng(count)
    boxes, other_boxes = random_boxes(rng, count), random_boxes(rng, others)
    tree, other_tree = BoxTree(boxes), BoxTree(other_boxes)
    seen = 0
    for k in range(15):
        rotation, position = Rotation.random(random_state=k).as_matrix(), rng.uniform(0.0, 2.0) * rng.normal(size=3)
        reach = rng.uniform(0.0, 0.5)
        turned = [around(box, rotation, position) for box in other_boxes]
        distances = np.array([[distance(box, other) for other in turned] for box in boxes])
        pairs = tree.pairs(other_tree, rotation, position, reach)
        assert pairs.tolist() == np.argwhere(distances <= reach).tolist()
        seen += len(pairs)
    assert seen
