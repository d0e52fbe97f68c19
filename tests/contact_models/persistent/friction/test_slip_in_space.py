"""Slip in two directions, where explicit stages are unstable: digits, order, and stops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ffsm_mj
from tests.contact_models.persistent.friction.scenes import at, block, final, heat, pulled, slips, sphere, sticks, yaw
from tests.replays import proved

LONG_STEPS = [1e-3, 5e-4]

U0 = np.array((1.3, 0.5))
STOP_S = 2.0 * np.linalg.norm(U0) / (7.0 * 0.2)

PULL = [[0.4, 0, 0], [0.5, 0, 0], [0, 0.6, 0]]
"""(0.4 + 0.5 t, 0.6 t^2) N."""


def curving(folder, step):
    """A sphere that slides across its spin; the path to rolling is a parabola."""
    return sphere(folder, mu=0.2, velocity=(0.7, -0.4, 0), spin=(0.9, -0.6, 2), step=step, duration=2.4)


@pytest.mark.long
@pytest.mark.parametrize("step", [1e-2, 8e-3, 4e-3, *LONG_STEPS])
def test_a_sphere_slides_along_a_parabola(tmp_path, step):
    """Coulomb friction keeps its direction: u0 (1 - t / t*), t* = 2 |u0| / (7 mu g); all by closed form.

    Steps of order 4, of which what is left at the stop is known from 4 ms: 1.5e-11 of the velocity, 1.5e-9 of the time.
    """
    run = proved(ffsm_mj.run(curving(tmp_path, step)))
    allowed = 3e-11 * max(1.0, (step / 4e-3) ** 4) + 1e-12
    spent = 2.4 - STOP_S
    velocity = np.array((0.7, -0.4)) - 2.0 / 7.0 * U0
    place = np.array((0.7, -0.4)) * STOP_S - U0 / 7.0 * STOP_S
    np.testing.assert_allclose(final(run, "v_robot_free")[:2], velocity, atol=allowed)
    np.testing.assert_allclose(final(run, "q_robot_free")[:2], place + velocity * spent, atol=3 * allowed)
    assert velocity == pytest.approx([0.328571428571, -0.542857142857], abs=1e-12)
    assert place == pytest.approx([1.0233101591, -0.9380343126], abs=1e-10)
    assert heat(run) == pytest.approx(0.2 * np.linalg.norm(U0) * STOP_S / 2, abs=3 * allowed)
    assert sticks(run) == [pytest.approx(STOP_S, abs=max(5e-9, 500 * allowed))]


ERRORS = {4e-3: 1.7e-10, 2e-3: 1.2e-11, 1e-3: 1.3e-12, 5e-4: 1.7e-13}
"""Errors of the rates at 0.6 s by step, of a prototype with the same stages."""


@pytest.mark.long
@pytest.mark.parametrize("step", [4e-3, 2e-3, *LONG_STEPS])
def test_a_foot_breaks_away_along_a_curve(tmp_path, step):
    """It slips where (0.4 + 0.5 t)^2 + 0.36 t^4 = 0.25, and then turns; reference by Radau IIA to 1e-12."""
    run = proved(ffsm_mj.run(pulled(tmp_path, step, PULL)))
    assert slips(run) == [pytest.approx(0.198873109993, abs=1e-11)]
    rates = [*final(run, "v_robot_x"), *final(run, "v_robot_y")]
    assert rates == pytest.approx([0.042675671986, 0.011535190635], abs=3 * ERRORS[step] + 1e-12)
    place = [*final(run, "q_robot_x"), *final(run, "q_robot_y")]
    assert place == pytest.approx([0.005646726679, 0.001185072537], abs=3 * ERRORS[step] + 1e-12)


def spinning(folder, step, duration):
    """A block on four corners that slides and spins."""
    return block(folder, mu=0.3, velocity=(0.6, 0.2, 0.0), spin=4.0, step=step, duration=duration)


CORNERS = np.array([(x, y) for x in (-0.2, 0.2) for y in (-0.1, 0.1)])


def of_three_coordinates(_, state, mu=0.3, height=0.05, inertia=(0.4**2 + 0.2**2) / 12):
    """Rates of (x, y, angle) and of their rates; normal forces of equal springs are affine in the place of the corner."""
    c, s = math.cos(state[2]), math.sin(state[2])
    r = CORNERS @ np.array(((c, s), (-s, c)))
    u = state[3:5] + state[5] * np.stack((-r[:, 1], r[:, 0]), axis=1)
    d = -mu * u / np.linalg.norm(u, axis=1)[:, None]
    # Per unit of normal force: itself, and its moments with that of friction at the foot about the mass centre.
    each = np.stack((np.ones(4), r[:, 1] + height * d[:, 1], -r[:, 0] - height * d[:, 0]))
    shape = np.column_stack((np.ones(4), r))
    normal = shape @ np.linalg.solve(each @ shape, (1.0, 0.0, 0.0))
    force = normal[:, None] * d
    turn = np.sum(r[:, 0] * force[:, 1] - r[:, 1] * force[:, 0]) / inertia
    return [*state[3:], *force.sum(axis=0), turn]


SPIN_ERRORS = {4e-3: 7.7e-10, 2e-3: 3.9e-11, 1e-3: 2.4e-12, 5e-4: 1e-12}
"""Errors of pose and rates by step, of a prototype with the same stages."""


@pytest.mark.long
@pytest.mark.parametrize("step", [4e-3, 2e-3, *LONG_STEPS])
def test_a_block_slides_and_spins_on_four_corners(tmp_path, step):
    """Equal springs at the corners, against a reduced model of three coordinates by DOP853."""
    run = proved(ffsm_mj.run(spinning(tmp_path, step, 0.4)))
    reduced = solve_ivp(of_three_coordinates, (0, 0.4), (0, 0, 0, 0.6, 0.2, 4.0), method="DOP853", rtol=1e-13, atol=1e-14)
    vx, vy, _, _, _, spin = final(run, "v_robot_free")
    found = [*final(run, "q_robot_free")[:2], yaw(run, "q_robot_free"), vx, vy, spin]
    np.testing.assert_allclose(found, reduced.y[:, -1], rtol=0, atol=3 * SPIN_ERRORS[step] + 2e-12)
    assert found[0] == pytest.approx(0.228376395007, abs=1e-8)
    assert spin == pytest.approx(2.740559454496, abs=1e-8)


@pytest.mark.long
@pytest.mark.parametrize(
    ("step", "place", "of_heat"),
    [(8e-3, 16 * 1.1e-8, 16 * 2.4e-11), (4e-3, 1.1e-8, 2.4e-11), (2e-3, 7.6e-10, 1.7e-12)],  # of order 4
)
def test_a_block_stops_sliding_and_spinning_at_one_instant(tmp_path, step, place, of_heat):
    """Translation and spin end together, at 2.5731523 s; all kinetic energy, 1/3 J, is heat."""
    run = proved(ffsm_mj.run(spinning(tmp_path, step, 2.6)))
    x, y, *_ = final(run, "q_robot_free")
    found = [x, y, yaw(run, "q_robot_free")]
    assert found == pytest.approx(
        [0.864641954, 0.273176478, 3.411144738 - 2 * math.pi * (found[2] < 0)], abs=3 * place + 1e-9
    )
    assert heat(run) == pytest.approx(1 / 3, abs=3 * of_heat + 1e-13)
    assert sticks(run) == [pytest.approx(2.5731523, abs=1e-7)]
    assert np.abs(final(run, "v_robot_free")).max() < 1e-12


@pytest.mark.parametrize(("step", "error"), [(8e-3, 1e-13), (4e-3, 7e-11)])
def test_the_start_of_a_slip_is_as_accurate_as_what_follows(tmp_path, step, error):
    """The foot's rates at 0.6 s; at 8 ms all steps are implicit, at 4 ms half of them are by RK4 soon after the start."""
    run = ffsm_mj.run(pulled(tmp_path, step, PULL))
    rates = np.array([*final(run, "v_robot_x"), *final(run, "v_robot_y")])
    assert np.abs(rates - (0.04267567198641, 0.01153519063534)).max() < 3 * error


def test_a_stop_is_at_rest_whatever_the_direction(tmp_path):
    """The same scene turned about the vertical: same speeds, same times, same heat.

    The direction of slip is kept below 1e-6 of its largest value, in the last 1e-7 s. Rounding decides in which sub-step it
    begins: over four angles the stop is seen to differ by 2.7e-9 s, and the heat by 1.0e-11 J.
    """
    angle = 0.7
    c, s = math.cos(angle), math.sin(angle)
    turned = lambda x, y: (c * x - s * y, s * x + c * y)  # noqa: E731
    runs = []
    for name, turn in (("one", lambda x, y: (x, y)), ("other", turned)):
        folder = tmp_path / name
        folder.mkdir()
        runs.append(
            proved(
                ffsm_mj.run(
                    sphere(
                        folder,
                        mu=0.2,
                        velocity=(*turn(0.3, -0.1), 0),
                        spin=(*turn(0.2, -0.1), 1),
                        step=8e-3,
                        duration=0.8,
                    )
                )
            )
        )
    one, other = runs
    np.testing.assert_allclose(final(other, "v_robot_free")[:2], turned(*final(one, "v_robot_free")[:2]), atol=1e-11)
    assert sticks(other) == pytest.approx(sticks(one), abs=1e-8)
    assert at(other, 0.4, "v_robot_free")[2] == pytest.approx(0.0, abs=1e-12)
    assert heat(other) == pytest.approx(heat(one), abs=3e-11)
