"""Measured impacts: what no law can beat, and what the momenta say of the frame."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize, nnls

from ffsm_mj.identification.impacts import frame_test, least_errors, moment_balance
from tests.identification.synthetic import MU, blocks, ellipses


@pytest.mark.parametrize("impacts", [ellipses(60), blocks(8)], ids=["plane", "space"])
def test_exact_impacts_have_no_least_error(impacts):
    """Their impulses are in the cone of their own mu, and not in a narrower one where they slide."""
    assert least_errors(impacts).errors.max() < 1e-14
    # The impulse of a sliding contact is on the cone: the projection leaves it there, to its end of 1e-14 of the impulse.
    assert least_errors(impacts, MU).errors.max() < 1e-12
    assert np.median(least_errors(impacts, 0.5 * MU).errors) > 0.01


def test_least_errors_in_the_plane_are_those_of_nonnegative_least_squares():
    """In the plane the cone is all nonnegative sums of its two edges."""
    impacts = ellipses(20, noise=0.3)
    edges = np.array([[1.0, 1.0], [MU, -MU]])
    change = impacts.weighted(impacts.after - impacts.before)
    oracle = [nnls(A.T @ edges, w)[1] for A, w in zip(impacts.A, change, strict=True)] / impacts.speeds
    # Errors are square roots of sums that nnls has to 1e-15: 1e-12 at errors above 1e-3.
    np.testing.assert_allclose(least_errors(impacts, MU).errors, oracle, atol=1e-12)
    assert np.all(least_errors(impacts).errors <= oracle + 1e-12)


def test_least_errors_in_space_are_those_of_a_minimum_over_the_cone():
    """Directions on the cone's surface are searched; the cone is narrow, so that the nearest impulse is on its surface."""
    impacts, mu = blocks(6), 0.05

    def error(A, change, angle):
        along = A.T @ np.array([1.0, mu * np.cos(angle), mu * np.sin(angle)])
        return float(np.linalg.norm(change - along * max(along @ change, 0.0) / (along @ along)))

    change = impacts.weighted(impacts.after - impacts.before)
    computed = least_errors(impacts, mu).errors * impacts.speeds
    for A, w, ours in zip(impacts.A, change, computed, strict=True):
        start = min(np.linspace(0, 2 * np.pi, 60), key=lambda angle, A=A, w=w: error(A, w, angle))
        oracle = minimize(lambda x, A=A, w=w: error(A, w, x[0]), [start], method="Nelder-Mead", options={"xatol": 1e-9})
        assert ours == pytest.approx(oracle.fun, rel=1e-9)  # a minimum is flat: 1e-9 in the angle is 1e-18 in its value


@pytest.mark.parametrize(
    ("mirror", "name"),
    [
        (lambda impacts: impacts, "as recorded"),
        (lambda impacts: impacts.with_reversed_tangents(), "tangents reversed"),
        (lambda impacts: impacts.with_reversed_rotation(), "rotation reversed"),
    ],
)
@pytest.mark.parametrize("impacts", [ellipses(60), blocks(8)], ids=["plane", "space"])
def test_the_frame_in_which_momenta_are_consistent_is_named(impacts, mirror, name):
    balances = frame_test(mirror(impacts))
    assert max(balances, key=lambda each: balances[each].r_squared) == name
    assert balances[name].r_squared == pytest.approx(1.0, abs=1e-12)
    assert balances[name].misses.max() < 1e-12
    assert all(balance.r_squared < 0.6 for each, balance in balances.items() if each != name)


def test_a_reversed_tangent_is_worse_than_no_prediction():
    """What the data of the ellipse show: R^2 below zero, a line of impulse that misses, friction that drives the slip."""
    exact, reversed_tangents = ellipses(60), ellipses(60).with_reversed_tangents()
    assert moment_balance(reversed_tangents).r_squared < 0.0
    assert np.median(moment_balance(reversed_tangents).misses) > 1e-3
    # Slip that reverses may end faster than it began, so that friction is along the mean slip in a few exact impacts too.
    assert moment_balance(exact).along_slip < 0.3
    assert moment_balance(reversed_tangents).along_slip > 0.5
    assert moment_balance(exact).slip_grows < moment_balance(reversed_tangents).slip_grows
    assert np.median(least_errors(reversed_tangents).errors) > 0.1


def test_energy_ratios_are_those_of_kinetic_energies():
    impacts = ellipses(5)
    energies = [[0.5 * v @ impacts.M @ v for v in velocities] for velocities in (impacts.after, impacts.before)]
    np.testing.assert_allclose(impacts.energy_ratios(impacts.after), np.divide(*energies), rtol=1e-14)
    assert impacts.energy_ratios(impacts.after).max() < 1.0
