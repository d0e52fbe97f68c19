"""Closed chains against minimal coordinates: a four-bar linkage driven by a torque, whose motion is one scalar equation.

With the crank angle q, the angles of coupler and rocker follow from the closure of the loop, and all velocities are
proportional to q'. With T = m(q) q'^2 / 2 the motion is m q'' + m' q'^2 / 2 = torque, integrated by DOP853.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ffsm_mj.dynamics.rigid_body import mass_matrix
from tests.dynamics.test_latch_rows import HEAD, TAIL, Chain

GROUND, CRANK, COUPLER, ROCKER = 1.0, 0.4, 0.9, 0.7
MASSES, INERTIAS = (1.0, 2.0, 1.5), (0.02, 0.1, 0.06)
OFFSETS = (0.05, 0.1, -0.08)
"""Mass centres across the links, m, from their middles."""


def torque(time_s):
    return 0.1 * math.sin(time_s)


def angles(q):
    """Angles of coupler and rocker in space by intersecting two circles, and their derivatives by q."""
    end = np.array((CRANK * math.cos(q), CRANK * math.sin(q)))
    to = np.array((GROUND, 0.0)) - end
    d = math.hypot(*to)
    along = (COUPLER**2 - ROCKER**2 + d * d) / (2.0 * d)
    across = math.sqrt(COUPLER**2 - along**2)
    joint = end + along / d * to + across / d * np.array((-to[1], to[0]))
    b = math.atan2(*(joint - end)[::-1])
    c = math.atan2(joint[1], joint[0] - GROUND)
    # CRANK q' n(q) + COUPLER b' n(b) = ROCKER c' n(c), n(x) = (-sin x, cos x)
    n = lambda x: np.array((-math.sin(x), math.cos(x)))  # noqa: E731
    b1, c1 = np.linalg.solve(np.column_stack((COUPLER * n(b), -ROCKER * n(c))), -CRANK * n(q))
    return b, c, float(b1), float(c1)


def inertia(q):
    """m(q): twice the kinetic energy per q'^2."""
    b, _, b1, c1 = angles(q)
    crank = CRANK * np.array((-math.sin(q), math.cos(q)))
    total = MASSES[0] * (0.25 * CRANK**2 + OFFSETS[0] ** 2) + INERTIAS[0]
    arm = 0.5 * COUPLER * np.array((-math.sin(b), math.cos(b))) - OFFSETS[1] * np.array((math.cos(b), math.sin(b)))
    v = crank + b1 * arm
    total += MASSES[1] * float(v @ v) + INERTIAS[1] * b1 * b1
    return total + (MASSES[2] * (0.25 * ROCKER**2 + OFFSETS[2] ** 2) + INERTIAS[2]) * c1 * c1


def slope(q):
    """m'(q) by a central difference of order six, to 1e-11."""
    h = 2e-3
    weights = (45.0, -9.0, 1.0)
    return sum(w * (inertia(q + k * h) - inertia(q - k * h)) for k, w in enumerate(weights, start=1)) / (60.0 * h)


def by_minimal_coordinates(q, rate, until_s):
    """Crank angle and its rate at the end."""
    right = lambda t, y: (y[1], (torque(t) - 0.5 * slope(y[0]) * y[1] ** 2) / inertia(y[0]))  # noqa: E731
    return solve_ivp(right, (0.0, until_s), (q, rate), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]


def linkage(q, rate, step_s):
    """Three links in series on a fixed base, the last one latched to the ground."""
    links, closing = "", ""
    b, c, b1, c1 = angles(q)
    for k, (length, mass, own, off) in enumerate(zip((CRANK, COUPLER, ROCKER), MASSES, INERTIAS, OFFSETS, strict=True)):
        at = "0 0 0" if k == 0 else f"{(CRANK, COUPLER)[k - 1]} 0 0"
        links += f'<body name="link{k}" pos="{at}"><joint axis="0 0 1"/>'
        links += f'<inertial pos="{0.5 * length} {off} 0" mass="{mass}" diaginertia="{own} {own} {own}"/>'
        closing += "</body>"
    chain = Chain(HEAD + links + closing + TAIL, step_s)
    # The rocker points from the coupler to the ground: its angle is that of the other direction.
    chain.data.qpos[:] = q, b - q, c + math.pi - b
    chain.data.qvel[:] = rate, (b1 - 1.0) * rate, (c1 - b1) * rate
    chain.forward()
    chain.latch("world", "link2", (GROUND, 0.0, 0.0), "hinge", (0.0, 0.0, 1.0))
    return chain


def efforts(data):
    data.qfrc_applied[0] += torque(data.time)


def test_a_four_bar_moves_as_in_minimal_coordinates(request):
    """1e-9 after 10 s (2 s in the normal run), through whole turns; errors grow as (rate h)^4."""
    until_s = 10.0 if request.config.getoption("--long") else 2.0
    chain = linkage(0.8, 1.0, 1e-3)
    assert np.abs(chain.loops().rows().J @ chain.data.qvel).max() < 1e-14
    chain.run(until_s, efforts)
    q, rate = by_minimal_coordinates(0.8, 1.0, until_s)
    assert abs(chain.data.qpos[0] - q) < 1e-9
    assert abs(chain.data.qvel[0] - rate) < 1e-9
    # There is no projection here: errors of the rows are truncation.
    assert np.abs(chain.loops().errors()).max() < 1e-10
    assert abs(q - 0.8) > 2.0 * math.pi or until_s < 10.0


def test_its_error_falls_with_the_fourth_power_of_the_step():
    q, rate = by_minimal_coordinates(0.8, 3.0, 0.4)
    errors = []
    for step_s in (8e-3, 4e-3):
        chain = linkage(0.8, 3.0, step_s)
        chain.run(0.4, efforts)
        errors.append(np.hypot(chain.data.qpos[0] - q, chain.data.qvel[0] - rate))
    assert 12.0 < errors[0] / errors[1] < 22.0, errors


def test_acceleration_and_pivot_force_at_one_state():
    """Crank acceleration of the scalar equation; moments on the rocker about its other joint give the pivot force."""
    q, rate = 0.8, 3.0
    chain = linkage(q, rate, 1e-3)
    chain.data.qfrc_applied[0] = 0.7
    loops, M = chain.loops(), mass_matrix(chain.model, chain.data)
    generalised = loops.generalised(chain.force())
    expected = (0.7 - 0.5 * slope(q) * rate**2) / inertia(q)
    assert np.linalg.solve(M, chain.force() + generalised)[0] == pytest.approx(expected, abs=1e-9)
    _, force, moment = loops.wrench(0, loops.forces)
    # Of five rows two are independent in a planar mechanism; the other three carry nothing in the least norm.
    assert max(abs(force[2]), np.abs(moment).max()) < 1e-14
    _, c, _, c1 = angles(q)
    h = 1e-3
    turning = c1 * expected + rate**2 * (
        8.0 * (angles(q + h)[3] - angles(q - h)[3]) - angles(q + 2 * h)[3] + angles(q - 2 * h)[3]
    ) / (12.0 * h)
    out, across = np.array((math.cos(c), math.sin(c))), np.array((-math.sin(c), math.cos(c)))
    arm = (
        0.5 * ROCKER * out + OFFSETS[2] * -across
    )  # of the mass centre from the pivot; the link's own axes are turned by pi
    speed = c1 * rate
    centre = turning * np.array((-arm[1], arm[0])) - speed**2 * arm
    # About the joint, at ROCKER from the pivot: the pivot force is the only one with a moment.
    to_centre = arm - ROCKER * out
    moments = INERTIAS[2] * turning + MASSES[2] * (to_centre[0] * centre[1] - to_centre[1] * centre[0])
    to_pivot = -ROCKER * out
    assert to_pivot[0] * force[1] - to_pivot[1] * force[0] == pytest.approx(moments, abs=1e-8)
