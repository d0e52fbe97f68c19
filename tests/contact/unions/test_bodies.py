"""Unions in links, objects and welded bodies, against each other and against the robot that carries them."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

import ffsm_mj
from tests.contact.unions.drawing import cut
from tests.contact.unions.judge import sound
from tests.contact.unions.scenes import differences, fixed, free, geoms, on
from tests.contact.unions.test_slides import CUBE, HALVES, WHOLE, counted, place, speed
from tests.contact.unions.test_steps import STILL
from tests.random_scenes.dice import Dice
from tests.scenes import ARM, self_hit

OF_CUTS = 1e-9


def pieces_of(box, number=6, seed=1, name="b"):
    """A box cut at random along x and y, as geoms."""
    return geoms(cut(Dice(seed, "pieces"), [box], number), name)


@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_an_arm_hits_its_own_base_of_several_pieces(tmp_path, restitution):
    """Self-contact: the tip falls on the base, in one piece or six, and slides off again at e = 0."""
    hull = '<geom name="hull" type="box" size="0.2 0.2 0.2" mass="0"/>'
    assert hull in ARM
    cut_hull = pieces_of(((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2)), name="hull")
    whole = ffsm_mj.run(self_hit(tmp_path, pair=("base", "tip"), restitution=restitution))
    path = self_hit(tmp_path, pair=("base", "tip"), restitution=restitution)
    (tmp_path / "robot.xml").write_text(ARM.replace(hull, cut_hull))
    run = sound(ffsm_mj.run(path))
    assert len(whole.impacts) >= 1
    assert [*differences(whole, run, OF_CUTS)] == []


def test_a_body_of_two_pieces_slides_like_one(tmp_path):
    """The moving side is a union as well: its lower face is one, with four corners, wherever its seam is."""
    halves = [((-0.1, -0.1, -0.1), (0.03, 0.1, 0.1)), ((0.03, -0.1, -0.1), (0.1, 0.1, 0.1))]
    keys = {"joints": [-0.25, 0.01, 0.1, math.cos(0.2), 0, 0, math.sin(0.2)], "rates": [1, 0, 0, 0, 0, 0], "mu": 0.1}
    whole = ffsm_mj.run(on(tmp_path / "whole", CUBE, fixed(geoms(WHOLE)), **keys))
    for number, floor in enumerate((WHOLE, HALVES)):
        run = sound(ffsm_mj.run(on(tmp_path / str(number), free(geoms(halves, "g")), fixed(geoms(floor)), **keys)))
        assert [*differences(whole, run, OF_CUTS)] == []


def test_bodies_that_are_welded_are_one_solid(tmp_path):
    """Pieces in bodies of their own, without a joint between them: on both sides."""
    carried = """<geom name="g0" type="box" size=".05 .1 .1" pos="-.05 0 0" mass="0"/>
      <body name="front" pos=".05 0 0" quat="0 0 0 1"><geom name="g1" type="box" size=".05 .1 .1" mass="0"/></body>"""
    (first, second), keys = HALVES, {"joints": [-0.25, 0.01, 0.1, 1, 0, 0, 0], "rates": [1, 0, 0, 0, 0, 0.3], "mu": 0.2}
    floor = fixed(f'{geoms([first])}<body name="next" pos="0.5 0 -0.05"><geom name="c" type="box" size=".5 .5 .05"/></body>')
    assert second == ((0.0, -0.5, -0.1), (1.0, 0.5, 0.0))
    whole = ffsm_mj.run(on(tmp_path / "whole", CUBE, fixed(geoms(WHOLE)), **keys))
    run = sound(ffsm_mj.run(on(tmp_path / "welded", free(carried), floor, **keys)))
    assert counted(run) == (0, 1, 0)
    assert [*differences(whole, run, OF_CUTS)] == []


SLED = """<geom name="hull" type="box" size="0.12 0.1 0.03" pos="0 0 0.05" mass="0"/>
  <geom name="left" type="capsule" size="0.03" fromto="-0.1 0.08 0 0.1 0.08 0" mass="0"/>
  <geom name="right" type="capsule" size="0.03" fromto="-0.1 -0.08 0 0.1 -0.08 0" mass="0"/>"""
"""A box on two capsules, whose axes lie in its lower part."""


@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_a_sled_of_capsules_and_a_box_crosses_a_seam(tmp_path, mu):
    """It stands on two lines; x = x0 + v t - mu g t^2 / 2 until it rests."""
    keys = {"joints": [-0.25, 0, 0.03, 1, 0, 0, 0], "rates": [0.6, 0, 0, 0, 0, 0], "mu": mu, "duration_s": 0.8}
    whole = ffsm_mj.run(on(tmp_path / "whole", free(SLED), fixed(geoms(WHOLE)), **keys))
    run = sound(ffsm_mj.run(on(tmp_path / "halves", free(SLED), fixed(geoms(HALVES)), **keys)))
    assert len(run.impacts) == 0
    end = -0.25 + (0.6**2 / (2.0 * mu * 9.81) if mu else 0.6 * 0.8)
    assert place(run)[-1] == pytest.approx(end, abs=1e-10)
    assert [*differences(whole, run, OF_CUTS)] == []


def bar(ends, radius=0.05):
    """Cylinders end to end along x, with their upper side at z = 0."""
    texts = [
        f'<geom name="c{i}" type="cylinder" size="{radius}" fromto="{a!r} 0 -{radius} {b!r} 0 -{radius}" mass="0"/>'
        for i, (a, b) in enumerate(pairwise(ends))
    ]
    return fixed("".join(texts))


@pytest.mark.parametrize(("kind", "mu"), [("box", 0.0), ("box", 0.1), ("capsule", 0.1)])
def test_a_body_slides_over_the_joints_of_a_bar(tmp_path, kind, mu):
    """Coaxial cylinders of one radius: rims that two of them share are no feature, so that x = x0 + v t - mu g t^2 / 2."""
    geom, height = {
        "box": ('<geom name="g" type="box" size=".1 .1 .1" mass="0"/>', 0.1),
        "capsule": ('<geom name="g" type="capsule" size=".03" fromto="0 -.1 0 0 .1 0" mass="0"/>', 0.03),
    }[kind]
    keys = {"joints": [-0.25, 0, height, 1, 0, 0, 0], "rates": [0.5, 0, 0, 0, 0, 0], "mu": mu, "duration_s": 0.4}
    whole = ffsm_mj.run(on(tmp_path / "whole", free(geom), bar((-1.0, 1.0)), **keys))
    run = sound(ffsm_mj.run(on(tmp_path / "parts", free(geom), bar((-1.0, -0.2, -0.07, 0.3, 1.0)), **keys)))
    assert counted(run) == counted(whole)
    if kind == "box":
        assert place(run)[-1] == pytest.approx(-0.25 + 0.2 - 0.5 * mu * 9.81 * 0.16, abs=1e-10)
    assert [*differences(whole, run, OF_CUTS)] == []


def frame(inner, outer, half, style):
    """A square frame about z of four bars: those along x are as long as it, or those along y, or all are cut once more."""
    long, short = (-outer, outer), (-inner, inner)
    along_x, along_y = (long, short) if style == "x" else (short, long)
    boxes = []
    for side in (-1.0, 1.0):
        near, far = sorted((side * inner, side * outer))
        boxes.append(((along_x[0], near, -half), (along_x[1], far, half)))
        boxes.append(((near, along_y[0], -half), (far, along_y[1], half)))
    return cut(Dice(3, "frame"), boxes, 9) if style == "cut" else boxes


STYLES = ("x", "y", "cut")


def framed(folder, style, other, *, restitution=0.5, mu=0.2, **keys):
    """A frame that floats in a larger, fixed one, and bounces between its sides."""
    inside = free(geoms(frame(0.1, 0.14, 0.02, style), "g"), gravity=STILL, inertia=(0.01, 0.01, 0.02))
    outside = fixed(geoms(frame(0.2, 0.25, 0.05, other)), gravity=STILL)
    start = {"joints": [0.02, -0.01, 0.005, *TURN], "rates": [0.5, 0.33, 0.01, 0.1, 0.05, 1.5], "duration_s": 0.6}
    return ffsm_mj.run(on(folder, inside, outside, restitution=restitution, mu=mu, **start | keys))


TURN = (math.cos(0.1), 0.0, 0.0, math.sin(0.1))


@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_a_frame_in_a_frame(tmp_path, mu):
    """Two unions against each other; what bars they are made of changes nothing."""
    runs = {style: framed(tmp_path / style, style, other, mu=mu) for style, other in zip(STYLES, "yxx", strict=True)}
    first = sound(runs.pop("x"))
    assert len(first.impacts) >= 2
    for run in runs.values():
        sound(run)
        assert [*differences(first, run, OF_CUTS)] == []


def test_an_inner_frame_hooks_into_an_outer_one(tmp_path):
    """A frame across the plane of another one, each with a bar in the other's window: links of a chain."""
    across = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    runs = []
    for style, other in (("x", "y"), ("cut", "x")):
        inside = free(geoms(frame(0.1, 0.14, 0.02, style), "g"), gravity=STILL, inertia=(0.01, 0.01, 0.02))
        outside = fixed(geoms(frame(0.1, 0.14, 0.03, other)), gravity=STILL)
        keys = {"joints": [0.12, 0.0, 0.01, *across], "rates": [-0.05, 0.0, 0.6, 0.2, 0.3, 0.1], "restitution": 0.6}
        # Turned about x, its window faces along y; shifted along x by the middle of a bar, the bars pass the windows.
        runs.append(ffsm_mj.run(on(tmp_path / style, inside, outside, duration_s=0.8, mu=0.1, **keys)))
    first, run = map(sound, runs)
    assert len(first.impacts) >= 2
    assert speed(first, "vz_m_s").min() < 0.0
    assert [*differences(first, run, OF_CUTS)] == []
