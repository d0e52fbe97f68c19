"""Two contact rules in one plane: contact passes from one to the other at their seam, as an event in force alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ffsm_mj
from tests.contact.unions.judge import sound
from tests.contact.unions.scenes import fixed, free, geoms, on
from tests.contact.unions.test_slides import BALL, CUBE, G_M_S2, HALVES, place, speed

START_M = -0.25
FOURTHS = [
    *(((a, -0.5, -0.1), (b, 0.5, 0.0)) for a, b in ((-1.0, -0.1), (-0.1, 0.0), (0.0, 0.2))),
    ((0.2, -0.5, -0.1), (1.0, 0.5, 0.0)),
]


def over(folder, body, mu, boxes=HALVES, *, turned=False, **keys):
    """A body on two boxes, or several, of which those below x = 0 have the first mu and the others the second."""
    rules = [
        {
            "name": f"{'left' if box[1][0] <= 0.0 else 'right'}{number}" if len(boxes) > 2 else ("left", "right")[number],
            "between": [f"floor/b{number}", "robot"] if turned else ["robot", f"floor/b{number}"],
            "restitution": 0.0,
            "mu": mu[box[1][0] > 0.0],
        }
        for number, box in enumerate(boxes)
    ]
    keys = {"joints": [START_M, 0, 0.1, 1, 0, 0, 0], "contacts": {"rules": rules}, **keys}
    return sound(ffsm_mj.run(on(folder, body, fixed(geoms(boxes)), **keys)))


def times(run, kind, pair):
    return [record.time_s for record in run.records[kind] if record.pair == pair]


def after(speed_m_s, deceleration, length_m):
    """Time for a length, and the speed at its end."""
    end = math.sqrt(speed_m_s**2 - 2.0 * deceleration * length_m)
    return (speed_m_s - end) / deceleration if deceleration else length_m / speed_m_s, end


@pytest.mark.parametrize("mu", [(0.1, 0.3), (0.3, 0.1), (0.0, 0.4)])
@pytest.mark.parametrize("turned", [False, True])
def test_corners_of_a_box_pass_the_seam_of_two_rules(tmp_path, mu, turned):
    """Uniform deceleration in each of three parts: all corners on one, then the front ones on the other, then all.

    With its centre as high as it is long to either side, friction F = mu_r N_r + mu_f N_f shifts load to the front:
    N_f - N_r = F and N_f + N_r = m g, so that F / (m g) = (mu_r + mu_f) / (2 + mu_r - mu_f).
    """
    run = over(tmp_path, CUBE, mu, rates=[1.5, 0, 0, 0, 0, 0], turned=turned, duration_s=0.4)
    rear, front = mu
    first_s, second = after(1.5, rear * G_M_S2, 0.15)
    shares = (rear + front) / (2.0 + rear - front)
    between_s, third = after(second, shares * G_M_S2, 0.2)
    assert len(run.impacts) == 0
    # A corner leaves the face of a rule where it is CONTACT_GAP_M beyond it.
    assert times(run, "contact_beginnings", "right") == pytest.approx([first_s], abs=2e-9)
    assert times(run, "contact_endings", "left") == pytest.approx([first_s + between_s], abs=2e-9)
    left_s = 0.4 - first_s - between_s
    expected = 0.1 + third * left_s - 0.5 * front * G_M_S2 * left_s**2
    # 2e-9 s at a difference of decelerations of 4 m/s2, for the time that is left.
    assert place(run)[-1] == pytest.approx(expected, abs=4e-9)
    assert speed(run)[-1] == pytest.approx(third - front * G_M_S2 * left_s, abs=1e-8)


def test_more_pieces_of_both_rules_change_nothing(tmp_path):
    """The seams of pieces under rules of one mu: each passes contact on, and the motion is that on two."""
    whole = over(tmp_path / "two", CUBE, (0.1, 0.3), rates=[1.5, 0, 0, 0, 0, 0], duration_s=0.4)
    run = over(tmp_path / "four", CUBE, (0.1, 0.3), FOURTHS, rates=[1.5, 0, 0, 0, 0, 0], duration_s=0.4)
    assert len(run.impacts) == 0
    np.testing.assert_allclose(place(run), place(whole), atol=1e-11)


def test_a_sphere_begins_to_slip_at_the_seam_of_two_rules(tmp_path):
    """Without friction it slides at 0.5 m/s for 0.5 s; then it slips for 2 v / (7 mu g), and rolls at 5/7 v."""
    run = over(tmp_path, BALL, (0.0, 0.3), rates=[0.5, 0, 0, 0, 0, 0])
    slip_s = 1.0 / (7.0 * 0.3 * G_M_S2)
    assert len(run.impacts) == 0
    assert times(run, "contact_endings", "left") == pytest.approx([0.5], abs=3e-9)
    assert times(run, "contact_beginnings", "right") == pytest.approx([0.5], abs=3e-9)
    assert times(run, "contact_sticks", "right") == pytest.approx([0.5 + slip_s], abs=3e-9)
    rolled_m = 0.5 * slip_s - 0.15 * G_M_S2 * slip_s**2 + 5.0 / 14.0 * (0.5 - slip_s)
    assert place(run)[-1] == pytest.approx(rolled_m, abs=1e-9)
    assert speed(run)[-1] == pytest.approx(5.0 / 14.0, abs=1e-11)


def test_a_sphere_that_rolls_goes_on_where_there_is_no_friction(tmp_path):
    """Rolling needs none: speeds stay as they are, to the rounding of a run."""
    run = over(tmp_path, BALL, (0.3, 0.0), rates=[0.5, 0, 0, 0, 5.0, 0])
    assert len(run.impacts) == 0
    assert times(run, "contact_beginnings", "right") == pytest.approx([0.5], abs=3e-9)
    assert place(run)[-1] == pytest.approx(0.25, abs=1e-11)


def test_a_body_of_two_rules_on_one_plate(tmp_path):
    """The seam moves with the body: both halves slide, each with its mu, as the box half over a seam does."""
    halves = geoms([((-0.1, -0.1, -0.1), (0.0, 0.1, 0.1)), ((0.0, -0.1, -0.1), (0.1, 0.1, 0.1))], "g")
    rules = [
        {"name": name, "between": [f"robot/g{k}", "floor"], "restitution": 0.0, "mu": mu}
        for k, (name, mu) in enumerate((("rear", 0.1), ("front", 0.3)))
    ]
    path = on(
        tmp_path,
        free(halves),
        fixed(geoms([((-1.0, -0.5, -0.1), (1.0, 0.5, 0.0))])),
        joints=[START_M, 0, 0.1, 1, 0, 0, 0],
        rates=[1.5, 0, 0, 0, 0, 0],
        contacts={"rules": rules},
        duration_s=0.3,
    )
    run = sound(ffsm_mj.run(path))
    assert len(run.impacts) == 0
    assert speed(run)[-1] == pytest.approx(1.5 - 2.0 / 9.0 * G_M_S2 * 0.3, abs=1e-11)


def test_corners_of_a_turned_box_pass_one_after_another(tmp_path):
    """Four events in force: each passes one corner on, and no velocity jumps."""
    yaw = [math.cos(0.2), 0, 0, math.sin(0.2)]
    run = over(tmp_path, CUBE, (0.1, 0.3), joints=[START_M, 0.01, 0.1, *yaw], rates=[1.5, 0, 0, 0, 0, 0], duration_s=0.4)
    assert len(run.impacts) == 0
    passes = sorted({record.time_s for record in (*run.records["contact_changes"], *run.records["contact_endings"])})
    assert len(passes) == 4
    # Between rows speeds change by what friction does in a time step at most: 0.3 g at each point of the box.
    assert np.abs(np.diff(speed(run))).max() < 0.3 * G_M_S2 * 2e-3 * 1.01


def test_a_box_at_rest_on_the_seam_of_two_rules(tmp_path):
    """Its front corners lie on the seam exactly: each has one contact, and all four carry the weight."""
    run = over(tmp_path, CUBE, (0.1, 0.3), joints=[-0.1, 0, 0.1, 1, 0, 0, 0], duration_s=0.1)
    (begins,) = run.records["contact_beginnings"]
    assert (begins.pair, begins.time_s) == ("left", 0.0)
    assert begins.force_after_N == pytest.approx(2.0 * G_M_S2, abs=1e-9)


@pytest.mark.parametrize(
    "body",
    [
        CUBE,
        free('<geom name="g" type="capsule" size="0.06 0.1" quat="0.7071067811865476 0 0.7071067811865476 0" mass="0"/>'),
    ],
    ids=["box", "capsule"],
)
def test_a_body_lands_on_a_corner_of_four_rules(tmp_path, body):
    """Of one face or edge each rule has a corner: each is an impact of the whole patch."""
    quarters = [((x, y, -0.1), (x + 1.0, y + 1.0, 0.0)) for x, y in ((-1, -1), (0, -1), (-1, 0), (0, 0))]
    rules = [
        {"name": f"r{i}", "between": ["robot", f"floor/b{i}"], "restitution": 0.0, "mu": mu}
        for i, mu in enumerate((0.1, 0.3, 0.2, 0.4))
    ]
    yaw = [math.cos(0.55), 0, 0, math.sin(0.55)]
    keys = {"rates": [0.4, -0.3, 0, 0, 0, 3.0], "contacts": {"rules": rules}, "duration_s": 0.2}
    path = on(tmp_path, body, fixed(geoms(quarters)), joints=[0.01, 0.02, 0.101, *yaw], **keys)
    run = sound(ffsm_mj.run(path))
    assert {impact.manifold for impact in run.impacts} == {"face" if body is CUBE else "edge"}
    assert len({impact.rule for impact in run.impacts}) == len(run.impacts) == (4 if body is CUBE else 2)
