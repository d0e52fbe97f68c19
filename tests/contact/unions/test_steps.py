"""Real steps, concave corners, needles and slots: features of the union stop a body, and nothing else does."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

import ffsm_mj
from tests.contact.unions.judge import sound
from tests.contact.unions.scenes import differences, fixed, free, geoms, on
from tests.contact.unions.test_slides import CUBE, counted, place, speed
from tests.random_scenes.dice import numbers

STEP_M = 1e-6
NEAR = (-0.13, 0, 0.1, 1, 0, 0, 0)
"""State of the cube, 0.03 m before the step."""


def stepped(height, depth=0.1):
    """Two boxes, of which the larger one, at x < 0, has its upper face at z = 0, the other one this much higher."""
    return [((-1.0, -0.5, -0.1), (0.0, 0.5, 0.0)), ((0.0, -0.5, -depth), (0.8, 0.5, height))]


def sliding(folder, boxes, **keys):
    """The cube at 0.5 m/s along x, from -0.25 m on."""
    keys = {"joints": [-0.25, 0, 0.1, 1, 0, 0, 0], "rates": [0.5, 0, 0, 0, 0, 0], **keys}
    return ffsm_mj.run(on(folder, CUBE, fixed(geoms(boxes)), **keys))


def impulse_of(run):
    """Impulses of the first impact on the cube, summed over its contacts, world axes, (3,)."""
    first = [impact for impact in run.impacts if impact.event == run.impacts[0].event]
    return -sum(impact.impulse_N_s * np.array(impact.normal) for impact in first), first[0].time_s


def struck(run):
    """Normals of impacts with an impulse, from body to floor; contacts that take part without one are left out."""
    return {tuple((np.round(impact.normal, 9) + 0.0).tolist()) for impact in run.impacts if impact.impulse_N_s > 1e-12}


@pytest.mark.parametrize("height", [1e-6, 1e-3, 0.05])
def test_a_box_trips_over_a_step(tmp_path, height):
    """Case 6: the edge of the step stops the point of the box at its height, the floor the lower edge.

    The box turns about both: m v (h0 - h) = w (I + m (h0 - h)^2 + m a^2), with its centre h0 = a = 0.1 m above its lower
    edge and behind its front. At h -> 0 the impulse is 7/12 N s.
    """
    mass, inertia, lever = 2.0, 0.008, 0.1 - height
    turn = mass * 0.5 * lever / (inertia + mass * lever**2 + mass * 0.01)
    run = sound(sliding(tmp_path, stepped(height), joints=NEAR, duration_s=0.08))
    (x, y, z), time_s = impulse_of(run)
    assert time_s == pytest.approx(0.06, abs=1e-12)
    # The gap is below 1e-9 m where it closes: so much are levers off.
    assert (x, y, z) == pytest.approx((mass * (turn * lever - 0.5), 0.0, mass * turn * 0.1), abs=1e-9)
    after = run.impacts[0].qvel_after["robot/free"]
    assert after[4] == pytest.approx(turn, abs=1e-9)
    kept = 0.5 * (mass * (after[0] ** 2 + after[2] ** 2) + inertia * turn**2) / 0.25
    assert kept == pytest.approx(turn * lever / 0.5, abs=1e-9)


@pytest.mark.parametrize("height", [0.1, 0.3])
def test_a_step_up_to_the_centre_and_a_wall_stop_the_box(tmp_path, height):
    """1.0 N s, and nothing turns."""
    run = sound(sliding(tmp_path, stepped(height), joints=NEAR, duration_s=0.1))
    assert impulse_of(run)[0] == pytest.approx((-1.0, 0.0, 0.0), abs=1e-11)
    assert place(run)[-1] == pytest.approx(-0.1, abs=1e-9)
    assert abs(speed(run)[-1]) < 1e-11


def test_a_step_within_the_weld_is_none(tmp_path):
    """Case 7: the larger face leads, and the step of 1 um is gone; the motion is that on one plane."""
    run = sound(sliding(tmp_path, stepped(STEP_M), contacts={"weld_m": 1e-5, "rules": [RULE]}))
    assert counted(run) == (0, 1, 0)
    assert place(run)[-1] == pytest.approx(0.25, abs=1e-12)


RULE = {"name": "hit", "between": ["robot", "floor"], "restitution": 0.0, "mu": 0.0}


def test_a_step_down_stops_nothing(tmp_path):
    """Case 14: until its centre passes the edge the box goes on level; what follows has no part along x."""
    run = sound(sliding(tmp_path, stepped(-STEP_M), joints=NEAR, duration_s=0.5))
    first_s = min((impact.time_s for impact in run.impacts), default=1.0)
    assert first_s > 0.26  # its centre is over the edge
    # It tips by 1 um over 0.1 m at most.
    assert all(abs(impact.normal[0]) < 2e-5 for impact in run.impacts)
    assert speed(run)[-1] == pytest.approx(0.5, abs=1e-4)


def test_pieces_of_a_plate_that_alternate_in_height_are_one_plane(tmp_path):
    """Case 13: twelve pieces, every other one 1e-9 m higher: at a weld of 1e-8 m there is one height, and no impact."""
    cuts = np.linspace(-0.9, 0.9, 12)  # the first piece is the largest
    edges = [-1.5, *cuts]
    boxes = [((a, -0.5, -0.1), (b, 0.5, 1e-9 * (i % 2))) for i, (a, b) in enumerate(pairwise(edges))]
    run = sound(sliding(tmp_path, boxes, contacts={"weld_m": 1e-8, "rules": [RULE]}))
    assert counted(run) == (0, 1, 0)
    assert place(run)[-1] == pytest.approx(0.25, abs=1e-12)


CORNER = [
    *(((-1.0, a, -0.1), (0.5, b, 0.0)) for a, b in ((-0.5, 0.05), (0.05, 0.5))),
    *(((0.5, a, -0.1), (0.6, b, 1.0)) for a, b in ((-0.5, -0.1), (-0.1, 0.5))),
]
"""A floor and a wall at x = 0.5, each cut across, at other places."""


def test_a_box_stops_in_a_concave_corner(tmp_path):
    """Case 8: the only set of normals that keeps the box out has both of floor and wall."""
    run = sound(sliding(tmp_path, CORNER, joints=[0.36, 0, 0.1, 1, 0, 0, 0], duration_s=0.15))
    assert impulse_of(run)[0] == pytest.approx((-1.0, 0.0, 0.0), abs=1e-11)
    assert struck(run) == {(1.0, 0.0, 0.0)}
    assert place(run)[-1] == pytest.approx(0.4, abs=1e-9)


def test_a_box_slides_along_a_concave_corner(tmp_path):
    """It touches floor and wall, and passes the seams of both."""
    keys = {"joints": [0.4, -0.17, 0.1, 1, 0, 0, 0], "rates": [0, 0.5, 0, 0, 0, 0], "duration_s": 0.5}
    run = sound(sliding(tmp_path, CORNER, **keys))
    assert len(run.impacts) == 0
    assert (place(run)[-1], place(run, "y_m")[-1]) == pytest.approx((0.4, 0.08), abs=1e-11)


def needle(height=0.2, side=0.02):
    """A pyramid with its tip at the origin of the body; vertices of meshes are known in single precision, to 1e-8 m."""
    corners = [(sx * side, sy * side, height) for sx in (-1, 1) for sy in (-1, 1)]
    mesh = f'<mesh name="tip" vertex="0 0 0 {" ".join(map(numbers, corners))}"/>'
    text = free('<geom name="g" type="mesh" mesh="tip" mass="0"/>', assets=mesh, inertia=(0.02, 0.02, 0.002))
    return text.replace('pos="0 0 0" mass', f'pos="0 0 {0.75 * height}" mass')


def tip(half=0.05):
    """A cube on its corner, which is the origin of the body, in double precision; it floats without gravity."""
    # About the axis across the diagonal of the upper face, by the angle between the cube's diagonal and z.
    angle = math.acos(1.0 / math.sqrt(3.0)) / 2.0
    turn = (math.cos(angle), -math.sin(angle) / math.sqrt(2.0), math.sin(angle) / math.sqrt(2.0), 0.0)
    place = (0.0, 0.0, math.sqrt(3.0) * half)
    geom = f'<geom name="g" type="box" size="{half} {half} {half}" pos="{numbers(place)}" quat="{numbers(turn)}" mass="0"/>'
    return free(geom, gravity=STILL).replace('pos="0 0 0" mass', f'pos="{numbers(place)}" mass')


STILL = '<option gravity="0 0 0"/>'


QUARTERS = [((x, y, -0.1), (x + 0.5, y + 0.5, 0.0)) for x, y in ((-0.5, -0.5), (0.0, -0.5), (-0.5, 0.0), (0.0, 0.0))]


@pytest.mark.parametrize("at", [(0.0, 0.1), (0.1, 0.0), (0.0, 0.0)])
def test_a_needle_stands_on_a_seam(tmp_path, at):
    """Case 9: its tip falls on a seam, or on the corner of four boxes, and stops there: pair by pair it would enter.

    The impulse acts along the axis of the needle: all of m v.
    """
    path = on(tmp_path, needle(), fixed(geoms(QUARTERS)), joints=[*at, 0.05, 1, 0, 0, 0], duration_s=0.2)
    run = sound(ffsm_mj.run(path))
    impulse, time_s = impulse_of(run)
    assert time_s == pytest.approx(math.sqrt(0.1 / 9.81), abs=2e-8)
    assert impulse == pytest.approx((0.0, 0.0, 2.0 * math.sqrt(0.1 * 9.81)), abs=1e-6)
    assert len(run.impacts) == 1
    assert abs(place(run, "z_m")[-1]) < 1e-8


@pytest.mark.parametrize(("down", "impacts"), [(0.0, 0), (1.0, 1)])
def test_a_tip_crosses_the_corner_of_four_boxes(tmp_path, down, impacts):
    """Case 10: along (0.3, 0.4, 0) nothing stops it; with a part downwards only the upper face does.

    It moves without gravity so that it does not fall over, and reaches the corner after 0.1 s.
    """
    floor = fixed(geoms(QUARTERS), gravity=STILL)
    start = [-0.03, -0.04, 0.1 * down, 1, 0, 0, 0]
    run = sound(ffsm_mj.run(on(tmp_path, tip(), floor, joints=start, rates=[0.3, 0.4, -down, 0, 0, 0], duration_s=0.2)))
    assert len(run.impacts) == impacts
    assert all(impact.normal == pytest.approx((0.0, 0.0, -1.0), abs=1e-12) for impact in run.impacts)
    assert speed(run)[-1] == pytest.approx(0.3, abs=1e-11)
    assert speed(run, "vy_m_s")[-1] == pytest.approx(0.4, abs=1e-11)


def test_a_box_crosses_the_corner_of_four_boxes_like_the_whole(tmp_path):
    keys = {"joints": [-0.15, -0.2, 0.1, 1, 0, 0, 0], "rates": [0.3, 0.4, 0, 0, 0, 0]}
    whole = ffsm_mj.run(on(tmp_path / "whole", CUBE, fixed(geoms([((-0.5, -0.5, -0.1), (0.5, 0.5, 0.0))])), **keys))
    run = sound(ffsm_mj.run(on(tmp_path / "four", CUBE, fixed(geoms(QUARTERS)), **keys)))
    assert counted(run) == (0, 1, 0)
    assert [*differences(whole, run, 1e-12)] == []


def slot(cuts):
    """A T-slot along y, cut across: floor, two side walls, two lips over it; its inner space is 0.3 m by 0.2 m."""
    spans = [((-0.5 if i == 0 else cuts[i - 1]), (0.5 if i == len(cuts) else cuts[i])) for i in range(len(cuts) + 1)]
    profiles = (
        ((-0.25, -0.1), (0.25, 0.0)),
        ((-0.25, 0.0), (-0.15, 0.3)),
        ((0.15, 0.0), (0.25, 0.3)),
        ((-0.15, 0.2), (-0.05, 0.3)),
        ((0.05, 0.2), (0.15, 0.3)),
    )
    return [((low[0], a, low[1]), (high[0], b, high[1])) for low, high in profiles for a, b in spans]


@pytest.mark.parametrize(
    ("rates", "normals"),
    [
        ((0.0, 0.3, 0.0), set()),
        ((0.0, 0.3, 0.2), {(0.0, 0.0, 1.0)}),
        ((0.2, 0.3, 0.0), {(1.0, 0.0, 0.0)}),
        ((-0.1, 0.3, -0.1), set()),
    ],
    ids=["along", "up", "sideways", "away"],
)
def test_a_slider_in_a_slot(tmp_path, rates, normals):
    """Case 11: it touches the lower side of a lip, whose inner edge it stands under, and the wall: along both it is free."""
    # Pieces share faces bit for bit only where their numbers do: these are sums of sizes and places.
    body = free('<geom name="g" type="box" size="0.1 0.1 0.05" mass="0"/>', gravity=STILL)
    floor = fixed(geoms(slot([-0.1, 0.05, 0.13])), gravity=STILL)
    path = on(tmp_path, body, floor, joints=[0.05, -0.27, 0.15, 1, 0, 0, 0], rates=[*rates, 0, 0, 0], duration_s=0.3)
    run = sound(ffsm_mj.run(path))
    assert struck(run) == normals
    assert place(run, "y_m")[-1] == pytest.approx(-0.27 + 0.3 * 0.3, abs=1e-11)


@pytest.mark.parametrize(
    ("across_m", "rates", "normals"),
    [
        (0.0, (0.1, 0.0, -0.2), set()),
        (0.0, (-0.1, 0.0, 0.2), set()),
        (0.0, (0.0, 0.0, -0.2), set()),
        (0.0, (-0.1, 0.0, -0.2), {(-1.0, 0.0, 0.0)}),
        (0.6, (-0.1, -0.2, 0.05), set()),
        (0.6, (-0.1, -0.2, -0.05), {(0.0, 0.0, -1.0)}),
    ],
    ids=["beside", "above", "down the side", "into the edge", "above the corner", "into the corner"],
)
def test_boxes_whose_edges_lie_on_each_other(tmp_path, across_m, rates, normals):
    """Edge on edge, or corner on corner, no unions: they overlap if they approach along all normals of the faces there.

    The impulse is along the one that they approach least along, and turns the point back at e = 1: 2 v / (1 / m + r^2 / I),
    with the normal r = 0.1 m from the centre along each axis across it.
    """
    body = free('<geom name="g" type="box" size="0.1 0.1 0.1" mass="0"/>', gravity=STILL)
    floor = fixed(geoms([((-1.0, -0.5, -0.5), (0.0, 0.5, 0.0))]), gravity=STILL)
    keys = {"joints": [0.1, across_m, 0.1, 1, 0, 0, 0], "rates": [*rates, 0, 0, 0], "restitution": 1.0}
    run = sound(ffsm_mj.run(on(tmp_path, body, floor, duration_s=0.05, **keys)))
    assert struck(run) == normals
    for normal in normals:
        levers = 2 if across_m else 1  # the impulses at both ends of an edge are level with the centre
        impulse = 2.0 * np.dot(rates, normal) / (1.0 / 2.0 + levers * 0.01 / 0.008)
        assert np.linalg.norm(impulse_of(run)[0]) == pytest.approx(impulse, rel=1e-12)


def test_bars_that_meet_an_edge_leave_the_rest_of_it_as_it_is(tmp_path):
    """A cube stands by its lower edge on the edge of a bar, beyond two others that end flush with it on its side.

    The others cut the edge into three: nothing of it may change where the cube stands, 18 cm from the next one.
    """
    slope, half_turn = 0.3, math.pi / 8.0
    edge, up = np.array((0.0, math.cos(slope), -math.sin(slope))), np.array((0.0, math.sin(slope), math.cos(slope)))
    # The middle above the contact point: 0.1 sqrt(2) above the lower edge of the cube, and back along that.
    middle = np.array((0.3, 0.0, 0.0)) + 0.1 * math.sqrt(2.0) * (up - math.tan(slope) * edge)
    c, s, u, v = math.cos(0.5 * slope), -math.sin(0.5 * slope), math.cos(half_turn), math.sin(half_turn)
    keys = {"joints": [*middle, c * u, s * u, c * v, s * v], "mu": 1.0, "duration_s": 0.1}
    bar = ((-0.5, -0.2, -0.1), (0.5, 0.0, 0.0))
    others = [((x - 0.02, 0.0, -0.1), (x + 0.02, 0.3, 0.0)) for x in (-0.1, 0.1)]
    alone = ffsm_mj.run(on(tmp_path / "alone", CUBE, fixed(geoms([bar])), **keys))
    run = sound(ffsm_mj.run(on(tmp_path / "joined", CUBE, fixed(geoms([bar, *others])), **keys)))
    assert [record.mode for record in run.records["contact_beginnings"]] == ["edge on edge"]
    assert [*differences(alone, run, 1e-9)] == []
