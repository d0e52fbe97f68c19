"""Friction through ``resolve`` on MuJoCo models: closed forms and invariants."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.impact import Contact, resolve

UP = np.array([0.0, 0.0, 1.0])
SPHERE = """<mujoco><option gravity="0 0 0"/><worldbody><body name="ball">
  <inertial pos="0 0 0" mass="1" diaginertia="0.4 0.4 0.4"/><freejoint/><geom size="1" mass="0"/></body>
  </worldbody></mujoco>"""
ROD = """<mujoco><option gravity="0 0 0"/><worldbody><body name="rod">
  <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.08 0.08333333333333333"/>
  <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 0 1"/>
  <geom size="0.1" mass="0"/></body></worldbody></mujoco>"""
BOX = """<mujoco><option gravity="0 0 0"/><worldbody><body name="box">
  <inertial pos="0 0 0" mass="2" diaginertia="{} {} {}"/><freejoint/><geom size="0.1" mass="0"/></body>
  </worldbody></mujoco>"""
BOX = BOX.format(*(2 / 3 * (a * a + b * b) for a, b in ((0.3, 0.2), (0.5, 0.2), (0.5, 0.3))))


def moving(xml, qvel):
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qvel[:] = qvel
    mujoco.mj_forward(model, data)
    return model, data


def on_floor(xml, qvel, point, mu, e, normal=UP):
    """One body on the fixed world, which is a."""
    model, data = moving(xml, qvel)
    return resolve(model, data, [Contact(0, 1, np.array(point), normal, e, mu)])


def at_contact(impact):
    """Normal and slip velocity after."""
    return impact.separation_speeds[0], impact.friction.slip_after[0]


@pytest.mark.parametrize(
    ("v", "omega", "mu", "e", "after", "spin", "path"),
    [
        ((0.72, 0.96, -1), (0, 0, 0), 0.2, 0.5, (0.54, 0.72, 0.5), (-0.6, 0.45, 0), "slip"),
        ((0.6, 0.8, -1), (0, 0, 0), 0.5, 0.7, (3 / 7, 4 / 7, 0.7), (-4 / 7, 3 / 7, 0), "slip, stick"),
        ((2, 0, -1), (0, -5, 0), 0.2, 0.8, (1.64, 0, 0.8), (0, -4.1, 0), "slip"),
    ],
)
def test_a_sphere_on_the_floor(v, omega, mu, e, after, spin, path):
    """It slips throughout if mu (1 + e) |u_n| <= 2/7 |u_t|; else it ends rolling."""
    impact = on_floor(SPHERE, (*v, *omega), (0, 0, -1), mu, e)
    np.testing.assert_allclose(impact.after.qvel, (*after, *spin), rtol=0, atol=1e-12)
    assert (impact.law, impact.status, impact.friction.paths) == ("stronge", "ok", (path,))
    lost = impact.friction.normal_work[0] + impact.friction.friction_work[0]
    assert impact.energy_change_J == pytest.approx(lost, abs=1e-12)


def test_a_sphere_that_spins_about_all_axes():
    """Spin about the normal is unchanged: a point contact does not resist it. Digits to eight places."""
    impact = on_floor(SPHERE, (1, 0.5, -1, 2, -1, 3), (0, 0, -1), 0.3, 0.6)
    expected = (0.70014638, 0.12518297, 0.6, 1.06295743, -0.25036594, 3)
    np.testing.assert_allclose(impact.after.qvel, expected, rtol=0, atol=1e-8)
    assert impact.energy_change_J == pytest.approx(-1.45354982, abs=1e-8)


@pytest.mark.parametrize(
    ("angle", "slip", "mu", "e", "after", "change"),
    [
        (45, 1.0, 0.3, 0.5, (0.4508414397, -0.0511208519), -0.1943079790),  # it slips back
        (45, -0.3, 0.7, 1.0, (1.0231324450, 0.0), -0.126),  # faster away than it came, and yet energy is lost
        (45, -0.2, 1.0, 0.5, (0.5513619501, 0.0), -0.305),
        (55, 0.7, 0.3, 1.0, (0.8214594951, -0.3531069466), -0.0687596295),  # Newton's law would gain half of T here
    ],
)
def test_a_rod_that_strikes_with_its_end(angle, slip, mu, e, after, change):
    """Normal and tangent are coupled: e is a ratio of works, not of speeds."""
    th = math.radians(angle)
    end = (-math.cos(th) / 2, -math.sin(th) / 2, 0.0)
    impact = on_floor(ROD, (slip, -1, 0, 0), end, mu, e, normal=np.array([0.0, 1.0, 0.0]))
    normal, tangential = at_contact(impact)
    np.testing.assert_allclose((normal, *tangential), (after[0], after[1], 0, 0), rtol=0, atol=1e-9)
    assert impact.energy_change_J == pytest.approx(change, abs=1e-9)
    work = impact.friction.normal_work[0], impact.friction.compression_work[0]
    assert work[0] == pytest.approx((1 - e * e) * work[1], abs=1e-12)


@pytest.mark.parametrize(
    ("mu", "after", "change"),
    [
        (0.3, (0.3644281285, 0.4189231920, 0.5930976291), -0.2829486448),
        (1.2, (0.0054730910, 0.0038337262, 0.5953825657), -0.3780811990),
    ],
)
def test_a_box_that_strikes_with_a_corner(mu, after, change):
    """The direction of slip turns: the path is curved."""
    impact = on_floor(BOX, (0.4, -0.3, -1, 0.2, 0.5, 1), (0.5, 0.3, -0.2), mu, 0.5)
    normal, slip = at_contact(impact)
    np.testing.assert_allclose(slip + normal * UP, after, rtol=0, atol=1e-9)
    assert impact.energy_change_J == pytest.approx(change, abs=1e-9)
    if mu == 0.3:
        np.testing.assert_allclose(impact.vectors[0], (-0.1000425309, -0.1772330116, 0.6913291951), rtol=0, atol=1e-9)


def corners(mu=0.3, e=0.5):
    return [Contact(0, 1, np.array([x, y, -0.2]), UP, e, mu) for x in (-0.5, 0.5) for y in (-0.3, 0.3)]


@pytest.mark.parametrize("law", ["blend", "poisson"])
def test_a_box_that_slides_in_flat(law):
    """Four corners, of which three suffice: v+ = (.05, 0, .5), without spin, in any order of the contacts."""
    model, data = moving(BOX, (0.5, 0, -1, 0, 0, 0))
    impact = resolve(model, data, corners(), law)
    np.testing.assert_allclose(impact.after.qvel, (0.05, 0, 0.5, 0, 0, 0), rtol=0, atol=1e-9)
    assert impact.energy_change_J == pytest.approx(-0.9975, abs=1e-9)
    assert impact.law == {"blend": "coulomb"}.get(law, law)
    order = [2, 0, 3, 1]
    again = resolve(model, data, [corners()[i] for i in order], law)
    assert np.array_equal(again.after.qvel, impact.after.qvel)
    assert np.array_equal(again.vectors, impact.vectors[order])
    assert again.friction.paths == tuple(impact.friction.paths[i] for i in order)


@pytest.mark.parametrize(("changes", "error"), [({"restitution": 1.2}, UnsupportedContactError), ({"mu": -0.1}, ValueError)])
def test_contacts_without_law_are_refused(changes, error):
    model, data = moving(SPHERE, (0.72, 0.96, -1, 0, 0, 0))
    with pytest.raises(error, match="mu"):
        resolve(model, data, [Contact(0, 1, -UP, UP, **{"restitution": 0.5, "mu": 0.2} | changes)])


BODIES = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="one"><inertial pos="0.1 -0.2 0.05" mass="{}" diaginertia="{} {} {}"/><freejoint/><geom size="0.1" mass="0"/>
    <body name="arm" pos="0.3 0 0"><joint axis="0 1 0"/><inertial pos="0.2 0 0" mass="0.5" diaginertia="0.01 0.02 0.02"/>
      <geom size="0.1" mass="0"/></body></body>
  <body name="two"><inertial pos="0 0.1 -0.1" mass="{}" diaginertia="{} {} {}"/><freejoint/>
    <geom size="0.1" mass="0"/></body>
  </worldbody></mujoco>"""


def bodies(rng):
    """A body with an arm and another one in any state, and one to four contacts between any of them."""
    sizes = rng.uniform(0.3, 3.0, (2, 4))
    numbers = [[m, *(0.2 * m * (1.0 + each / each.sum()))] for m, each in zip(sizes[:, 0], sizes[:, 1:], strict=True)]
    model = mujoco.MjModel.from_xml_string(BODIES.format(*numbers[0], *numbers[1]))
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
    data.qvel[:] = rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    contacts = []
    for _ in range(rng.integers(1, 5)):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        e, mu = rng.choice([0.0, 1.0, rng.uniform()]), rng.uniform(0.0, 1.5)
        contacts.append(Contact(int(rng.integers(1, 3)), 3, rng.normal(scale=0.5, size=3), n, e, mu))
    return model, data, contacts


@pytest.mark.long
@pytest.mark.parametrize("seed", range(300))
def test_random_bodies(seed):
    """P and L are conserved, energy never grows, impulses are >= 0 and inside their cones, no contact approaches."""
    model, data, contacts = bodies(np.random.default_rng(seed))
    impact = resolve(model, data, contacts, ("blend", "poisson")[seed % 2])
    assert impact.status in ("ok", "energy_guard", "jammed", "wedged")
    # P and L are sums of some ten terms of their own size, times the condition of M, up to 1e2.
    scale = 1.0 + np.abs(impact.before.momentum).max() + np.abs(impact.vectors).max()
    np.testing.assert_allclose(impact.momentum_change, 0.0, atol=1e-12 * scale)
    energy = impact.before.kinetic_energy_J
    assert impact.energy_change_J <= 1e-12 * energy
    works = (impact.friction.normal_work + impact.friction.friction_work).sum()
    assert impact.energy_change_J == pytest.approx(works, abs=1e-9 * energy)
    sizes = np.linalg.norm(impact.friction.impulses, axis=1)
    assert (impact.impulses >= 0.0).all()
    assert (sizes <= [c.mu * p * (1 + 1e-12) + 1e-15 for c, p in zip(contacts, impact.impulses, strict=True)]).all()
    fastest = max(np.abs(impact.approach_speeds).max(), np.abs(impact.friction.slip_before).max())
    assert impact.separation_speeds.min() >= -1e-8 * fastest


def turned(model, data, contacts, quaternion, drift):
    """The same scene rotated about the origin, in a moving frame."""
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quaternion)
    R = R.reshape(3, 3)
    other = mujoco.MjData(model)
    other.qpos[:], other.qvel[:] = data.qpos, data.qvel
    for q, v in ((0, 0), (8, 7)):  # of the free joints; angular velocities are in body axes
        other.qpos[q : q + 3] = R @ data.qpos[q : q + 3]
        mujoco.mju_mulQuat(other.qpos[q + 3 : q + 7], quaternion, data.qpos[q + 3 : q + 7].copy())
        other.qvel[v : v + 3] = R @ data.qvel[v : v + 3] + drift
    mujoco.mj_forward(model, other)
    moved = [Contact(c.body_a, c.body_b, R @ c.point, R @ c.normal, c.restitution, c.mu) for c in contacts]
    return other, moved, R


@pytest.mark.parametrize("seed", [1, 2, 3, 5])
def test_turned_and_boosted_scenes_are_the_same(seed):
    """One contact, or two: full rank, so that the solution is unique."""
    rng = np.random.default_rng(seed)
    model, data, contacts = bodies(rng)
    contacts = (contacts * 2)[: 1 + seed % 2] if len(contacts) > 1 else contacts
    impact = resolve(model, data, contacts)
    quaternion, drift = rng.normal(size=4), rng.normal(size=3)
    other, moved, R = turned(model, data, contacts, quaternion / np.linalg.norm(quaternion), drift)
    again = resolve(model, other, moved)
    expected = impact.after.qvel.copy()
    for v in (0, 7):
        expected[v : v + 3] = R @ expected[v : v + 3] + drift
    # The path of one contact is integrated to 1e-11 in other coordinates.
    np.testing.assert_allclose(again.after.qvel, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again.vectors, impact.vectors @ R.T, rtol=0, atol=1e-9)
    assert again.friction.paths == impact.friction.paths


@pytest.mark.parametrize("mu", [0.0, 0.4])
def test_squeezed_between_two_walls_is_jammed(mu):
    """No elastic solution, with friction or without: energy is lost, and the status says so."""
    model, data = moving(SPHERE, (1, 0.3, 0.1, 0, 0, 2))
    x = np.array([1.0, 0.0, 0.0])
    impact = resolve(model, data, [Contact(0, 1, -x, x, 1.0, mu), Contact(0, 1, x, -x, 1.0, mu)])
    assert impact.status == "jammed"
    assert impact.energy_change_J < 0.0
    assert impact.separation_speeds.min() > -1e-8
