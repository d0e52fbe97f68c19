"""What is not evaluated: pieces that bounds keep apart, and those beyond the plane on which a body lies; and what is."""

from __future__ import annotations

from collections import Counter

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact.sides import Side
from ffsm_mj.contact.union_pair import PiecePair, UnionPair
from tests.contact.unions.judge import sound
from tests.contact.unions.scenes import fixed, free, geoms, on

ROD = '<geom name="g" type="capsule" size="0.05 0.1" zaxis="0 1 0" mass="0"/>'
BODY = """<geom name="ball" size="0.05" mass="0"/><geom name="box" type="box" size="0.03 0.04 0.05" pos="0.07 0 0" mass="0"/>
  <geom name="rod" type="capsule" size="0.02 0.15" pos="0 0.04 0" mass="0"/>"""


def tiles(count, width):
    """A floor of tiles along x, whose upper side is at z = 0."""
    return [((k * width, -0.3, -0.1), ((k + 1) * width, 0.3, 0.0)) for k in range(count)]


def counting(monkeypatch, kind, name):
    """Counts the calls of a method."""
    calls, method = Counter(), getattr(kind, name)

    def counted(self, *arguments, **keywords):
        calls[name] += 1
        return method(self, *arguments, **keywords)

    monkeypatch.setattr(kind, name, counted)
    return calls


@pytest.mark.parametrize("across", [1, 40])  # by the spheres of all pairs, and by the trees
def test_the_gap_is_the_least_of_all_pieces(tmp_path, rng, monkeypatch, across):
    """At random places, and of a few queries: a bound that is too large would leave out the nearest pieces."""
    places = [(0.1 * i, 0.1 * k, 0.03 * ((i + k) % 3)) for i in range(12) for k in range(across)]
    floor = [((x, y, -0.1), (x + 0.1, y + 0.1, height)) for x, y, height in places]
    path = on(tmp_path, free(BODY), fixed(geoms(floor)), joints=[0, 0, 1, 1, 0, 0, 0])
    assembly = prepare(path).assemble()
    model, data = assembly.system.mj, assembly.data
    (union,) = assembly.pairs
    queries, most = counting(monkeypatch, PiecePair, "gap"), []
    for _ in range(8):
        data.qpos[:3] = rng.uniform((0.0, 0.0, 0.05), (1.2, 0.1 * across, 0.5))
        data.qpos[3:7] = rng.normal(size=4)
        mujoco.mj_kinematics(model, data)
        queries.clear()
        gap = union.gap(model, data, 10.0)
        most.append(queries["gap"])
        numbers_of = range(3 * len(floor))
        # The query of a pair stops at a limit: it is the gap in all that are nearer.
        assert gap == min(union.piece_pair(k).gap(model, data, 10.0) for k in numbers_of)
        near = [k for _, k in union.within(model, data, gap + 0.05)]
        assert sorted(near) == [k for k in numbers_of if union.piece_pair(k).gap(model, data, 10.0) < gap + 0.05]
    assert np.median(most) < 12


def test_a_rod_on_many_tiles_costs_what_one_on_a_plate_does(tmp_path, monkeypatch):
    """It rolls over 16 seams: pieces are asked when they come below it, and not as long as the plane parts them from it."""
    run = {"joints": [0.1, 0, 0.05, 1, 0, 0, 0], "rates": [0.5, 0, 0, 0, 10.0, 0], "mu": 0.3, "duration_s": 1.6}
    calls, spent = counting(monkeypatch, PiecePair, "proximity"), []
    for count in (1, 20):
        width = 1.0 / count
        calls.clear()
        rolled = ffsm_mj.run(on(tmp_path / str(count), free(ROD), fixed(geoms(tiles(count, width))), **run))
        assert len(rolled.impacts) == 0
        spent.append(calls["proximity"])
    # Each tile once where it comes below, once more in the records of the start.
    assert spent[1] - spent[0] <= 2 * 20


def test_what_stands_on_the_plane_stops_the_rod(tmp_path):
    """It is beside the rod, not beyond the plane: a wall at x = 0.5 is met where the rod has come within its radius."""
    wall = [*tiles(20, 0.05), ((0.5, -0.3, -0.1), (0.6, 0.3, 0.2))]
    keys = {"joints": [0.1, 0, 0.05, 1, 0, 0, 0], "rates": [0.5, 0, 0, 0, 10.0, 0], "mu": 0.0, "duration_s": 1.0}
    run = sound(ffsm_mj.run(on(tmp_path, free(ROD), fixed(geoms(wall)), **keys)))
    assert [impact.time_s for impact in run.impacts[:2]] == pytest.approx([(0.5 - 0.05 - 0.1) / 0.5] * 2, abs=1e-11)


def test_a_higher_tile_is_met_at_its_edge(tmp_path):
    """A step of 1 mm up: the plane of the first tile does not part the ball from the second."""
    ball = '<geom name="g" size="0.05" mass="0"/>'
    up = [((0.0, -0.3, -0.1), (0.3, 0.3, 0.0)), ((0.3, -0.3, -0.1), (0.6, 0.3, 1e-3))]
    keys = {"joints": [0.1, 0, 0.05, 1, 0, 0, 0], "rates": [0.5, 0, 0, 0, 0, 0], "duration_s": 0.5}
    run = sound(ffsm_mj.run(on(tmp_path, free(ball), fixed(geoms(up)), **keys)))
    reach = np.sqrt(0.05**2 - 0.049**2)  # the edge touches the ball this far ahead of its middle
    assert run.impacts[0].time_s == pytest.approx((0.2 - reach) / 0.5, abs=1e-11)


def test_without_unions_there_are_none(monkeypatch):
    """A run without bodies of several touching pieces makes no union, and asks once a body whether it is one."""
    monkeypatch.setattr(Side, "__init__", None)
    monkeypatch.setattr(UnionPair, "__init__", None)
    assert ffsm_mj.run("push", {"duration_s": 0.05}).outcome == "completed"
