"""The impact map alone: closed forms, the paper's Appendix A and its equations, invariants."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.impact import Contact, contact_jacobian, reflect, resolve, solve_paper_system

LEFT = np.array([-1.0, 0.0, 0.0])


def tip_contact(system, x, y, e=1.0):
    return Contact(system.index("body", "payload"), system.index("body", "box"), np.array([x, y, 0.0]), LEFT, e)


def test_appendix_a_at_the_printed_contact_point(case_study, impact_state):
    """Every figure printed in the paper, within one unit of its last digit."""
    impact = resolve(case_study.mj, impact_state, [tip_contact(case_study, 4.0, -0.3172)])
    printed = (0.1354, -0.0641, 0.0258, 0.0133, -0.1059, 0.0979, -0.2445, 0.0, 0.2682)
    assert impact.impulses[0] == pytest.approx(1.2226, abs=1e-4)
    np.testing.assert_allclose(impact.after.qvel, printed, rtol=0, atol=1.0001e-4)
    angular = np.cross([0.5, 0.1828, 0.0], impact.impulses[0] * LEFT)[2]
    assert angular == pytest.approx(0.2235, abs=1e-4)
    assert impact.before.kinetic_energy_J == pytest.approx(0.28, abs=0.005)


def test_appendix_a_at_the_tip(case_study, impact_state):
    """Figures of the independent simulation; the state is given to nine decimals, which changes them by about 5e-9."""
    impact = resolve(case_study.mj, impact_state, [tip_contact(case_study, 4.000756738, -0.316940821)])
    assert impact.impulses[0] == pytest.approx(1.222381959, abs=1e-8)
    np.testing.assert_allclose(impact.after.qvel[6:], (-0.244476392, 0.0, 0.268532627), rtol=0, atol=1e-8)
    after = (0.135392276, -0.06405441, 0.025772885, 0.013376111, -0.105878565, 0.097889204)
    np.testing.assert_allclose(impact.after.qvel[:6], after, rtol=0, atol=1e-8)


def test_paper_coefficients_of_equation_35(case_study, impact_state):
    """M^-1 J^T e_x as printed in (35), two digits; its signs are those of an impulse along +x."""
    solution = solve_paper_system(case_study, impact_state, tip_contact(case_study, 4.0, -0.3172))
    printed = (0.012, 0.0075, 0.031, 1.4e-4, 0.14, -0.37)
    digits = (5e-4, 5e-5, 5e-4, 4e-5, 5e-3, 5e-3)
    assert np.all(np.abs(-solution.slope - printed) <= np.array(digits))


def random_state(system, rng):
    data = mujoco.MjData(system.mj)
    data.qpos[:], data.qvel[:] = rng.uniform(-2, 2, system.mj.nq), rng.uniform(-1, 1, system.mj.nv)
    mujoco.mj_forward(system.mj, data)
    return data


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_resolution_solves_the_papers_equations(case_study, seed):
    """The closed form against (16)-(18), at random states: the object spins, the normal is oblique."""
    rng = np.random.default_rng(seed)
    data = random_state(case_study, rng)
    angle = rng.uniform(0, 2 * np.pi)
    normal = np.array([np.cos(angle), np.sin(angle), 0.0])
    contact = Contact(
        case_study.index("body", "payload"), case_study.index("body", "box"), np.append(rng.uniform(-2, 2, 2), 0.0), normal
    )
    after, impulse = reflect(mass_matrix(case_study.mj, data), contact_jacobian(case_study.mj, data, contact), data.qvel)
    paper = solve_paper_system(case_study, data, contact)
    # The momentum balance amplifies rounding by the condition of M, up to 1e3 for these poses.
    scale = 1.0 + np.abs(after).max()
    np.testing.assert_allclose(paper.robot_qvel, after[:6], rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(paper.object_qvel, after[6:], rtol=0, atol=1e-11 * scale)
    assert paper.impulse == pytest.approx(impulse, abs=1e-11 * (1 + abs(impulse)))


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), e=st.floats(0.0, 1.0))
def test_energy_and_momentum_of_one_contact(case_study, seed, e):
    """Energy change -(1 - e^2) u^2 / (2 J M^-1 J^T), momentum conserved, separation e times approach."""
    rng = np.random.default_rng(seed)
    data = random_state(case_study, rng)
    contact = tip_contact(case_study, *rng.uniform(-2, 2, 2), e=e)
    M, J = mass_matrix(case_study.mj, data), contact_jacobian(case_study.mj, data, contact)
    u = float(J @ data.qvel)
    impact = resolve(case_study.mj, data, [contact])
    if u >= 0.0:
        assert impact.impulses[0] == 0.0
        return
    T = impact.before.kinetic_energy_J
    loss = -(1 - e * e) * u * u / (2 * J @ np.linalg.solve(M, J))
    assert impact.energy_change_J == pytest.approx(loss, abs=1e-12 * (1 + T))
    assert impact.separation_speeds[0] == pytest.approx(-e * u, abs=1e-12 * (1 + abs(u)))
    assert impact.impulses[0] > 0.0
    scale = 1.0 + np.abs(impact.before.momentum).max()
    np.testing.assert_allclose(impact.momentum_change, 0.0, atol=1e-12 * scale)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_elastic_map_is_an_involution(case_study, seed):
    """A reflection in the metric of M, applied twice, returns the velocity."""
    data = random_state(case_study, np.random.default_rng(seed))
    M = mass_matrix(case_study.mj, data)
    J = contact_jacobian(case_study.mj, data, tip_contact(case_study, 1.0, 0.3))
    once, _ = reflect(M, J, data.qvel)
    twice, _ = reflect(M, J, once)
    np.testing.assert_allclose(twice, data.qvel, rtol=0, atol=1e-12 * (1 + np.abs(once).max()))


def test_rod_struck_off_centre():
    """1/k = 1/m + b^2/I + 1/m_ball; impulse (1 + e) k u; the rod spins with b impulse / I."""
    xml = """<mujoco><option gravity="0 0 0"/><worldbody>
      <body name="rod"><inertial pos="0 0 0" mass="2" diaginertia="0.1 0.7 0.7"/><freejoint/>
        <geom size=".01" mass="0"/></body>
      <body name="ball" pos="0.3 1 0"><inertial pos="0 0 0" mass="0.5" diaginertia="0.01 0.01 0.01"/><freejoint/>
        <geom size=".01" mass="0"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qvel[6:9] = (0.0, -2.0, 0.0)  # the ball comes down on the rod at b = 0.3
    contact = Contact(1, 2, np.array([0.3, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), 0.8)
    impact = resolve(model, data, [contact])
    k = 1.0 / (1 / 2.0 + 0.3**2 / 0.7 + 1 / 0.5)
    expected = 1.8 * k * 2.0
    assert impact.impulses[0] == pytest.approx(expected, rel=1e-14)
    assert impact.after.qvel[5] == pytest.approx(-0.3 * expected / 0.7, rel=1e-13)
    assert impact.after.qvel[1] == pytest.approx(-expected / 2.0, rel=1e-13)


def test_super_elastic_is_for_one_contact(case_study, impact_state):
    """With e > 1 energy grows by the formula; several such contacts at once have no law."""
    contact = tip_contact(case_study, 4.0, -0.3, e=1.2)
    impact = resolve(case_study.mj, impact_state, [contact])
    assert impact.energy_change_J > 0.0
    assert impact.separation_speeds[0] == pytest.approx(1.2 * impact.approach_speeds[0], rel=1e-12)
    with pytest.raises(UnsupportedContactError, match="one contact at a time"):
        resolve(case_study.mj, impact_state, [contact, contact])


def test_invalid_arguments_are_reported(case_study, impact_state):
    with pytest.raises(ValueError, match="unknown impact law 'guess'; allowed: blend, poisson, newton"):
        resolve(case_study.mj, impact_state, [tip_contact(case_study, 4.0, -0.3)], "guess")
    with pytest.raises(ValueError, match="at least one contact"):
        resolve(case_study.mj, impact_state, [])
