"""Features that are told as data and made again go on bit for bit, and everything that they remember is needed for that."""

from __future__ import annotations

from itertools import count

import mujoco
import pytest

from ffsm_mj.contact.features import point_line_gaps, rim_gaps, round_gaps
from ffsm_mj.contact.features.gap_function import GapFunction
from ffsm_mj.contact.features.search import StoredFeatures, features
from ffsm_mj.state import from_bytes, to_bytes
from tests.contact.features.test_gap_functions import in_contact, moved, pair_of
from tests.contact.test_geometry import SHAPES, shape
from tests.forgetting import forgetting

PIN = shape("cylinder").replace(SHAPES["cylinder"], 'type="cylinder" size="0.12 0.02"')
CASES = {
    (GapFunction, "radius"): (shape("capsule"), shape("box")),
    (GapFunction, "first_radius"): (shape("capsule"), shape("box")),
    (point_line_gaps.NearestOnCircle, "angle"): (PIN, shape("box")),
    (point_line_gaps.LineOnCurve, "nearest"): (PIN, shape("box")),
    (rim_gaps.RimOnRim, "angles"): (PIN, PIN),
    (rim_gaps.SideOnRim, "nearest"): (PIN, shape("capsule")),
    (rim_gaps.RimOnEllipsoid, "angle"): (PIN, shape("ellipsoid")),
    (round_gaps.EllipsoidOnEllipsoid, "last"): (shape("ellipsoid"), shape("ellipsoid")),
}
"""Two bodies, for each field of each state, whose feature cannot do without it."""


def evaluated(feature, model, data, start, velocity):
    """A feature at some states along a motion, as bytes."""
    found = b""
    for k in range(1, 4):
        data.qpos[:], data.qvel[:] = start, velocity
        mujoco.mj_integratePos(model, data.qpos, velocity, 0.004 * k)
        moved(model, data)
        found += to_bytes(tuple(feature.at(data)))
    return found


def followed(folder, rng, bodies, wanted):
    """Features of two bodies whose class has a state with a field, after a motion: each with the states that follow."""
    pair, model, data = pair_of(folder, *bodies)
    for _ in range(20):
        (feature, *_) = features(pair, model, data, in_contact(pair, model, data, rng))
        if isinstance(feature, wanted) or isinstance(getattr(feature, "_nearest", None), wanted):
            start, velocity = data.qpos.copy(), data.qvel.copy()
            feature.subtract_length(1e-6)
            evaluated(feature, model, data, start, velocity)
            yield feature, model, data, start, velocity


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(("kind", "field"), CASES, ids=[f"{kind.__name__}.{field}" for kind, field in CASES])
def test_made_again_and_forgetful(tmp_path, rng, kind, field):
    differ, number = 0, count()
    for feature, model, data, *motion in followed(tmp_path, rng, CASES[kind, field], kind):
        next(number)
        told = to_bytes(StoredFeatures(model).to_plain(feature))
        expected = evaluated(feature, model, data, *motion)
        assert evaluated(StoredFeatures(model).from_plain(from_bytes(told)), model, data, *motion) == expected
        with forgetting(kind, field):
            differ += evaluated(StoredFeatures(model).from_plain(from_bytes(told)), model, data, *motion) != expected
    assert next(number) >= 2
    assert differ >= 1
