"""Cones and rings of flat sectors, each a box: facets are real, seams within a facet are not."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ffsm_mj
from tests.contact.unions.judge import sound
from tests.contact.unions.scenes import fixed, free, on
from tests.random_scenes.dice import numbers

STILL = '<option gravity="0 0 0"/>'
SECTORS = 64
THROAT_M, MOUTH_M, LENGTH_M = 0.05, 0.3, 0.35
"""Radii of the corners of the cone at z = 0 and at its mouth."""
# A facet lies nearer to the axis than its corners.
APOTHEM = math.cos(math.pi / SECTORS)
SLOPE = math.atan2((MOUTH_M - THROAT_M) * APOTHEM, LENGTH_M)


def turned(angle, slope=0.0):
    """Axes of a facet at an azimuth, columns: along the slope, across it, and its inward normal, (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    up = np.array([c * math.sin(slope), s * math.sin(slope), math.cos(slope)])
    across = np.array([-s, c, 0.0])
    return np.column_stack((up, across, np.cross(up, across)))


def quaternion(axes):
    """Unit quaternion (w, x, y, z) of a rotation whose trace may be anything: eigenvector of the largest eigenvalue."""
    (a, b, c), (d, e, f), (g, h, i) = axes
    k = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    return np.linalg.eigh(k)[1][:, -1]


def slab(name, axes, middle, half, depth=0.02):
    """A box whose inner face has this middle, axes and half sizes."""
    centre = middle - depth * axes[:, 2]
    sizes, turn = numbers((*half, depth)), numbers(quaternion(axes))
    return f'<geom name="{name}" type="box" size="{sizes}" pos="{numbers(centre)}" quat="{turn}" mass="0"/>'


def cone(rings=1, sectors=range(SECTORS)):
    """Sectors of the cone, each a row of boxes along the slope.

    A box is as wide as the facet at the mouth: what is wider than the facet lies behind its neighbours.
    """
    texts, length = [], LENGTH_M / math.cos(SLOPE)
    for k in sectors:
        axes = turned((k + 0.5) * 2.0 * math.pi / SECTORS, SLOPE)
        foot = THROAT_M * APOTHEM * np.array([math.cos(azimuth(k)), math.sin(azimuth(k)), 0.0])
        for ring in range(rings):
            middle = foot + length * (ring + 0.5) / rings * axes[:, 0]
            half = length / rings / 2.0, MOUTH_M * math.tan(math.pi / SECTORS)
            texts.append(slab(f"s{k}r{ring}", axes, middle, half))
    return "".join(texts)


def azimuth(k):
    return (k + 0.5) * 2.0 * math.pi / SECTORS


@pytest.mark.parametrize("rings", [1, 4])
def test_a_square_peg_meets_two_facets_of_a_cone(tmp_path, rings):
    """Case 12: two corners meet two facets at once, by the symmetry of peg and cone about y = 0.

    Of the lower corners, (x + a, +-a, z), those toward the wall meet the facet on which the planes first reach
    n . corner = d; the peg goes straight down at 0.05 m/s.
    """
    half, speed, start = 0.02, 0.05, np.array([0.115, 0.0, 0.35])
    body = free(f'<geom name="g" type="box" size="{half} {half} 0.1" mass="0"/>', gravity=STILL)
    path = on(
        tmp_path,
        body,
        fixed(cone(rings), gravity=STILL),
        joints=[*start, 1, 0, 0, 0],
        rates=[0, 0, -speed, 0, 0, 0],
        duration_s=3.4,
        time_step_s=0.02,
        control_period_s=0.02,
        restitution=1.0,
    )
    run = sound(ffsm_mj.run(path))
    corner, times = start + np.array([half, half, -0.1]), []
    for k in range(SECTORS):
        axes = turned(azimuth(k), SLOPE)
        level = THROAT_M * APOTHEM * math.cos(SLOPE)  # distance of the axis at z = 0 from the facet
        times.append((corner @ axes[:, 2] + level) / (speed * axes[2, 2]))
    first_s, facet = min(times), int(np.argmin(times))
    hits = [impact for impact in run.impacts if impact.event == run.impacts[0].event]
    assert [hit.time_s for hit in hits] == pytest.approx([first_s] * 2, abs=1e-11)
    normal = turned(azimuth(facet), SLOPE)[:, 2]
    expected = [[-normal[0], side * abs(normal[1]), -normal[2]] for side in (-1.0, 1.0)]
    np.testing.assert_allclose(sorted((hit.normal for hit in hits), key=lambda one: one[1]), expected, atol=1e-12)
    assert (normal[0], abs(normal[1]), normal[2]) == pytest.approx((-0.805254, 0.119448, 0.580774), abs=5e-7)
    assert hits[0].impulse_N_s == pytest.approx(hits[1].impulse_N_s, rel=1e-11)
    assert len(run.impacts) == 2


def test_a_pad_slides_down_a_facet_over_the_seams_of_rings(tmp_path):
    """Case 12: pressed on the facet, it passes three seams (three impacts, pair by pair)."""
    axes = turned(azimuth(0), SLOPE)
    pull = -9.81 * axes[:, 2]
    gravity = f'<option gravity="{numbers(pull)}"/>'
    foot = THROAT_M * APOTHEM * np.array([math.cos(azimuth(0)), math.sin(azimuth(0)), 0.0])
    start = foot + 0.38 * axes[:, 0] + 0.005 * axes[:, 2]
    body = free('<geom name="g" type="box" size="0.008 0.004 0.005" mass="0"/>', gravity=gravity)
    sectors = [SECTORS - 1, 0, 1]
    path = on(
        tmp_path,
        body,
        fixed(cone(4, sectors), gravity=gravity),
        joints=[*start, *quaternion(axes)],
        rates=[*(-0.6 * axes[:, 0]), 0, 0, 0],
        duration_s=0.5,
    )
    run = sound(ffsm_mj.run(path))
    assert (len(run.impacts), len(run.records["contact_beginnings"])) == (0, 1)
    end = np.array([run[f"state.q_robot_free_{x}_m"][-1] for x in "xyz"])
    np.testing.assert_allclose(end, start - 0.3 * axes[:, 0], atol=1e-11)


def ring(facets, radius=0.3):
    """Facets of a ring about z, with this distance from the axis."""
    half = radius * math.tan(math.pi / facets)
    texts = []
    for k in range(facets):
        angle = (k + 0.5) * 2.0 * math.pi / facets
        axes = turned(angle)
        texts.append(slab(f"f{k}", axes, radius * np.array([math.cos(angle), math.sin(angle), 0.0]), (0.1, half)))
    return "".join(texts)


@pytest.mark.long
@pytest.mark.parametrize(("facets", "turn"), [(64, 0.25), (64, 1.0), (256, 1.0)])
def test_facets_of_a_ring_brake_a_ball(tmp_path, facets, turn):
    """Case 15: at e = 0 each corner takes the part of the velocity along the next normal: cos(2 pi/N) of the speed is left.

    In one turn cos^2N of the energy: 0.539106 for 64 facets, 0.857077 for 256.
    """
    radius, ball, angle = 0.3, 0.05, 2.0 * math.pi / facets
    body = free(f'<geom name="g" type="sphere" size="{ball}" mass="0"/>', gravity=STILL)
    # In the middle of the first facet; its centre runs along a polygon that is smaller by its radius.
    axes, inner = turned(angle / 2.0), radius - ball
    start = inner * np.array([math.cos(angle / 2.0), math.sin(angle / 2.0), 0.0])
    corners = round(turn * facets)
    # Half a side, then whole ones at falling speeds, then half of one.
    side, speed = 2.0 * inner * math.tan(angle / 2.0), math.cos(angle)
    duration = side * (0.5 + sum(speed**-k for k in range(1, corners)) + 0.5 * speed**-corners)
    path = on(
        tmp_path,
        body,
        fixed(ring(facets, radius), gravity=STILL),
        joints=[*start, 1, 0, 0, 0],
        rates=[*axes[:, 1], 0, 0, 0],
        duration_s=math.floor(duration / 5e-3) * 5e-3,
        time_step_s=5e-3,
        control_period_s=5e-3,
    )
    run = sound(ffsm_mj.run(path))
    energy = run["energy.robot_J"]
    assert len({impact.event for impact in run.impacts}) == corners
    assert energy[-1] / energy[0] == pytest.approx(speed ** (2 * corners), rel=1e-9)
    if turn == 1.0:
        assert energy[-1] / energy[0] == pytest.approx({64: 0.539106, 256: 0.857077}[facets], abs=5e-7)
