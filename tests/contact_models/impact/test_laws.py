"""Several contacts at one instant: published cases, thousands of random problems, physical scenes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.optimize import linprog

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact_models.impact.laws import FRICTIONLESS, blend, least_norm, newton, project
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.impact import Contact, compare_laws, resolve
from tests.scenes import ball, box, scene


def chain(count, *, wall=False):
    """Contact rows of unit masses in a row, each in contact with the next; a wall behind the last."""
    A = np.zeros((count - 1 + wall, count))
    for i in range(count - 1):
        A[i, i], A[i, i + 1] = -1.0, 1.0
    if wall:
        A[-1, -1] = -1.0
    return A


def velocities(law, A, v, e):
    """Velocities after, with unit masses."""
    return FRICTIONLESS[law](A, np.array(v, dtype=float), np.full(len(A), float(e))).w


@pytest.mark.parametrize(
    ("law", "A", "v", "e", "expected"),
    [
        ("blend", chain(3), (1, 0, 0), 1.0, (0, 0, 1)),
        ("poisson", chain(3), (1, 0, 0), 1.0, (-1 / 3, 2 / 3, 2 / 3)),
        ("newton", chain(3), (1, 0, 0), 1.0, (-1 / 3, 2 / 3, 2 / 3)),
        ("blend", chain(3), (1, 0, 0), 0.5, (1 / 6, 1 / 6, 2 / 3)),
        ("poisson", chain(3), (1, 0, 0), 0.5, (0, 0.5, 0.5)),
        ("blend", chain(4), (1, 1, 0, 0), 1.0, (0, 0, 1, 1)),
        ("blend", chain(2, wall=True), (1, 0), 1.0, (-1, 0)),
        ("blend", chain(2, wall=True), (1, 0), 0.5, (-0.5, 0)),
        ("blend", chain(3), (1, 0, -1), 0.5, (-0.5, 0, 0.5)),
    ],
)
def test_balls_in_a_row(law, A, v, e, expected):
    """Newton's cradle, ball-ball-wall, squeeze: textbook numbers of each law."""
    np.testing.assert_allclose(velocities(law, A, v, e), expected, atol=1e-12)


def test_break_shot_is_symmetric():
    """One ball hits two in contact: (-1/5; 3/5, +-0.346), symmetric to rounding."""
    n = np.array([[np.cos(0.5 * np.pi / 3), s * np.sin(0.5 * np.pi / 3)] for s in (1, -1)])
    A = np.zeros((3, 6))
    A[0, :2], A[0, 2:4] = -n[0], n[0]
    A[1, :2], A[1, 4:6] = -n[1], n[1]
    A[2, 2:4], A[2, 4:6] = (0, 1), (0, -1)  # the two, touching each other
    after = velocities("blend", A, (1, 0, 0, 0, 0, 0), 1.0)
    np.testing.assert_allclose(after, (-0.2, 0, 0.6, 0.34641016, 0.6, -0.34641016), atol=1e-8)
    assert after[3] == pytest.approx(-after[5], abs=1e-14)


def flat_box(velocity, e=1.0, *, law="blend"):
    """A box of 1 kg, 1 m x 1 m x 0.4 m, on the four corners of its base."""
    M = np.diag([1.0, 1.0, 1.0, 1.16 / 12, 1.16 / 12, 2.0 / 12])
    corners = [np.array([x, y, -0.2]) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    J = np.array([np.concatenate(([0, 0, 1.0], np.cross(c, [0, 0, 1.0]))) for c in corners])
    root = np.sqrt(np.diag(M))
    result = FRICTIONLESS[law](J / root, root * np.array(velocity, dtype=float), np.full(4, e))
    return result.w / root, result


def test_flat_box_rebounds_without_spin():
    """Four redundant contacts (rank 3): vz = +1, no spin, the load shared evenly."""
    after, result = flat_box((0, 0, -1, 0, 0, 0))
    np.testing.assert_allclose(after, (0, 0, 1, 0, 0, 0), atol=1e-13)
    np.testing.assert_allclose(result.impulses, 0.5, atol=1e-9)


def test_rocking_box_keeps_its_energy_and_leaves():
    """With vz = -0.5, wy = 3 on four points every corner leaves and T is conserved; equal springs agree to four digits."""
    after, _ = flat_box((0, 0, -0.5, 0, 3, 0))
    assert after[2] == pytest.approx(1.0444, abs=5e-5)
    assert after[4] == pytest.approx(-0.5503, abs=5e-5)


@pytest.mark.parametrize("law", ["blend", "poisson"])
@pytest.mark.parametrize("e", [0.0, 0.3, 0.8, 1.0])
def test_one_contact_is_the_closed_form(law, e, rng):
    for _ in range(50):
        A, w = rng.normal(size=(1, 4)), rng.normal(size=4)
        u = float((A @ w)[0])
        expected = max(0.0, -(1 + e) * u / float((A @ A.T)[0, 0]))
        assert FRICTIONLESS[law](A, w, np.array([e])).impulses[0] == pytest.approx(expected, abs=1e-13 * (1 + expected))


def random_problem(rng):
    """2 to 5 contacts in 2 to 6 dofs; every third has dependent rows, every fifth squeezes without clearance."""
    n, m = int(rng.integers(2, 7)), int(rng.integers(2, 6))
    A = rng.normal(size=(m, n))
    if rng.integers(3) == 0:
        A[-1] = rng.uniform(0.2, 2.0) * A[0]
    if rng.integers(5) == 0:
        A[-1] = -rng.uniform(0.2, 2.0) * A[0]
    return A, rng.normal(size=n)


def checked(law, A, w, e):
    """Result of a law after the inequalities that all laws must satisfy; tolerances relative to the velocities."""
    result = FRICTIONLESS[law](A, w, e)
    T, after = 0.5 * w @ w, 0.5 * result.w @ result.w
    # Energy never grows. Where NNLS gives up, Hildreth's sweeps stop at 1e-9 of the approach speed.
    assert after <= T * (1 + 1e-12)
    assert (A @ result.w).min() >= -1e-8 * np.abs(A @ w).max()
    assert result.impulses.min() >= 0.0
    np.testing.assert_allclose(w + A.T @ result.impulses, result.w, atol=1e-12 * (1 + np.abs(w).max()))
    return result, T, after


@pytest.mark.parametrize("law", ["blend", "poisson"])
@pytest.mark.long
@pytest.mark.parametrize("hundred", range(20))
def test_random_problems_with_a_restitution_per_contact(law, hundred):
    rng = np.random.default_rng([20240601, hundred])
    for _ in range(100):
        A, w = random_problem(rng)
        checked(law, A, w, rng.uniform(0, 1, len(A)))


@pytest.mark.long
@pytest.mark.parametrize("hundred", range(20))
def test_random_elastic_problems_conserve_energy(hundred):
    """With e = 1: |dT| < 1e-10 T unless jammed; jammed only if a direction is squeezed from both sides."""
    rng = np.random.default_rng([20240601, hundred])
    jams = 0
    for _ in range(100):
        A, w = random_problem(rng)
        result, T, after = checked("blend", A, w, np.ones(len(A)))
        if result.jammed:
            jams += 1
        else:
            assert abs(after - T) < 1e-10 * T
    assert 0 < jams < 45  # 27 in a hundred on average: four standard deviations more


def test_squeeze_without_clearance_is_jammed():
    """A ball hit from both sides at once between two walls has no elastic solution: energy is lost, and reported."""
    A = np.array([[1.0], [-1.0]])
    result = blend(A, np.array([1.0]), np.ones(2))
    assert result.jammed
    assert abs(result.w[0]) <= 1.0


def test_unequal_restitution_never_gains():
    """The case in which Newton's law fails: very different e at coupled contacts."""
    A = chain(3)
    for e in ([1.0, 0.0], [0.0, 1.0], [0.3, 0.9]):
        checked("blend", A, np.array([1.0, 0.0, -0.5]), np.array(e))


def test_newton_is_refused_where_it_is_inconsistent():
    A = chain(3)
    with pytest.raises(UnsupportedContactError, match="use 'poisson'"):
        newton(A, np.array([1.0, 0.0, 0.0]), np.array([0.5, 1.0]))
    with pytest.raises(UnsupportedContactError, match="use 'poisson'"):
        newton(A, np.array([1.0, 0.0, 1.0]), np.ones(2))


def test_sweeps_take_over_when_nnls_fails(monkeypatch, rng):
    """Once in thousands of problems NNLS misses its own optimality conditions: the verification must detect it."""
    import scipy.optimize

    problems = [random_problem(rng) for _ in range(30)]
    expected = [w + A.T @ project(A, w) for A, w in problems]
    monkeypatch.setattr(scipy.optimize, "nnls", lambda B, _: (np.ones(B.shape[1]), 0.0))
    for (A, w), good in zip(problems, expected, strict=True):
        np.testing.assert_allclose(w + A.T @ project(A, w), good, atol=1e-6)
    monkeypatch.setattr(scipy.optimize, "nnls", fail)
    A, w = problems[0]
    np.testing.assert_allclose(w + A.T @ project(A, w), expected[0], atol=1e-6)


@pytest.mark.parametrize("law", ["blend", "poisson", "newton"])
def test_without_nnls_redundant_contacts_get_the_same_velocities(monkeypatch, law):
    """Only the distribution over four corners is open then: impulses are >= 0, and their sum, 2 N s or less, is given.

    The sweeps end at a normal velocity of 1e-9 of the approach, 1 m/s.
    """
    expected, _ = flat_box((0, 0, -1, 0, 0, 0), law=law)
    import scipy.optimize

    monkeypatch.setattr(scipy.optimize, "nnls", fail)
    after, result = flat_box((0, 0, -1, 0, 0, 0), law=law)
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-8)
    assert result.impulses.min() >= 0.0
    assert result.impulses.sum() == pytest.approx(2.0, abs=1e-8)


def fail(*_):
    raise RuntimeError("maximum number of iterations reached")


def balls(count):
    """Free balls of 1 kg in a row, in contact."""
    bodies = "".join(f'<body pos="{0.2 * i} 0 0"><freejoint/><geom size="0.1" mass="1"/></body>' for i in range(count))
    model = mujoco.MjModel.from_xml_string(f"<mujoco><option gravity='0 0 0'/><worldbody>{bodies}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    x = np.array([1.0, 0, 0])
    contacts = [Contact(i + 1, i + 2, np.array([0.2 * i + 0.1, 0, 0]), x) for i in range(count - 1)]
    return model, data, contacts


def test_compare_laws_on_a_cradle():
    model, data, contacts = balls(3)
    data.qvel[0] = 1.0
    results = compare_laws(model, data, contacts)
    np.testing.assert_allclose(results["blend"].after.qvel[::6], (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(results["poisson"].after.qvel[::6], (-1 / 3, 2 / 3, 2 / 3), atol=1e-12)
    data.qvel[12] = 5.0
    assert "use 'poisson'" in compare_laws(model, data, contacts)["newton"]


def test_order_of_contacts_does_not_matter(rng):
    model, data, contacts = balls(4)
    data.qvel[:] = rng.normal(size=model.nv)
    there = resolve(model, data, contacts)
    back = resolve(model, data, contacts[::-1])
    np.testing.assert_allclose(there.after.qvel, back.after.qvel, atol=1e-12)


def test_a_box_lands_flat_on_a_face(tmp_path):
    """Face on face in a whole run: four extreme points at one event, rebound without spin, energy conserved."""
    path = scene(
        tmp_path,
        box("block", half=(0.3, 0.2, 0.1)),
        {"wall": box("wall", mass=2.0)},
        initial={"joints": {"wall/free": [1.5, 0.1, 0.05, 1, 0, 0, 0]}, "rates": {"robot/free": [1, 0, 0, 0, 0, 0]}},
        contacts={"rules": [{"between": ["block", "wall/wall"]}]},
    )
    run = ffsm_mj.run(path)
    assert run.outcome == "completed"
    assert len(run.impacts) == 4
    assert {record.event for record in run.impacts} == {0}
    assert {record.manifold for record in run.impacts} == {"face"}
    # The face of the block, 0.4 m by 0.2 m, lies wholly on the wall's.
    points = np.array(sorted(record.point_m for record in run.impacts))
    np.testing.assert_allclose(points, [[1.0, y, z] for y in (-0.2, 0.2) for z in (-0.1, 0.1)], atol=1e-9)
    before, after = run.impacts[0].qvel_before, run.impacts[0].qvel_after
    assert before["robot/free"][0] == 1.0
    # 1 kg on 2 kg off-centre: the wall is pushed at the middle of the four points, so it turns; the block must not tip.
    assert abs(run.impacts[0].energy_change_J) < 1e-12
    assert all(check.passes for check in all_checks(run, 1e-11))
    assert max(record.separation_speed_m_s for record in run.impacts) > 0.0
    assert min(record.separation_speed_m_s for record in run.impacts) > -1e-12
    assert after["wall/free"][0] > 0.0


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize(("right_mass", "expected"), [(1.0, (0, 0, 1)), (1e9, (-1, 0, 0))])
def test_three_balls_and_ball_ball_wall_in_a_run(tmp_path, right_mass, expected):
    """A ball hits the robot's, which touches a third: (0, 0, 1); with a third as heavy as a wall: (-1, 0, 0)."""
    path = scene(
        tmp_path,
        ball("ball", joints="x"),
        {"left": ball("left", joints="x"), "right": ball("right", mass=right_mass, joints="x")},
        initial={"joints": {"left/x": -0.5, "right/x": 0.2}, "rates": {"left/x": 1.0}},
        contacts={"rules": [{"between": ["robot/ball", f"{n}/{n}"]} for n in ("left", "right")]},
    )
    run = ffsm_mj.run(path)
    rates = [run[f"state.v_{name}_x_m_s"][-1] for name in ("left", "robot", "right")]
    np.testing.assert_allclose(rates, expected, atol=3e-9)  # the wall takes 2 / 1e9 of the velocity
    assert {record.event for record in run.impacts} == {0}


def test_two_grippers_on_one_box_at_once(tmp_path):
    """A two-pronged robot closes on a box from one side: both prongs touch at the same instant, symmetrically."""
    fork = """<mujoco><option gravity="0 0 0"/><worldbody><body name="fork"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="3" diaginertia="0.2 0.3 0.4"/>
      <geom name="upper" size="0.05" pos="0.5 0.2 0" mass="0"/><geom name="lower" size="0.05" pos="0.5 -0.2 0" mass="0"/>
      </body></worldbody></mujoco>"""
    path = scene(
        tmp_path,
        fork,
        {"crate": box("crate", mass=2.0)},
        initial={"joints": {"crate/free": [1.3, 0, 0, 1, 0, 0, 0]}, "rates": {"robot/free": [1, 0, 0, 0, 0, 0]}},
        contacts={"rules": [{"between": [g, "crate/crate"], "restitution": 0.8} for g in ("upper", "lower")]},
    )
    run = ffsm_mj.run(path)
    first, second = run.impacts
    assert first.event == second.event == 0
    assert first.time_s == pytest.approx(0.25, abs=1e-12)
    assert first.impulse_N_s == pytest.approx(second.impulse_N_s, rel=1e-12)
    after = first.qvel_after
    assert np.abs(after["robot/free"][3:]).max() < 1e-12
    assert after["crate/free"][0] - after["robot/free"][0] == pytest.approx(0.8, rel=1e-12)


def test_no_other_impulses_of_the_same_effect_are_shorter(rng):
    """The shortest impulse has an angle of at most 90 degrees with any allowed change of it: verified by linear programs."""
    pulled_out = 0
    for _ in range(100):
        dofs = int(rng.integers(1, 5))
        A = rng.normal(size=(dofs + int(rng.integers(1, 5)), dofs)) * 10.0 ** rng.uniform(-2, 2)
        impulses = project(A, rng.normal(size=dofs))
        shortest, effect = least_norm(A, impulses), A.T @ impulses
        assert shortest.min() >= 0.0
        np.testing.assert_allclose(A.T @ shortest, effect, atol=1e-11 * np.abs(A).max() * max(1e-300, impulses.max()))
        least = linprog(shortest, A_eq=A.T, b_eq=effect)  # over all non-negative ones
        assert least.fun >= shortest @ shortest * (1.0 - 1e-6)  # its feasibility is 1e-7
        pulled_out += bool(impulses.any()) and shortest.min() == 0.0
    assert pulled_out > 10


def test_points_at_one_place_share_an_impulse():
    """Shares of the others are zero to rounding, of either sign: that is no reason to leave the impulse to one of two."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        places = rng.integers(-1, 2, (3, 2))
        A = np.column_stack((np.ones(4), np.vstack((places, places[-1:]))))
        impulses = project(A, -A[-1] * rng.uniform(0.5, 2.0))
        shared = least_norm(A, impulses)
        assert shared[2] == pytest.approx(shared[3], abs=1e-12)
        np.testing.assert_allclose(A.T @ shared, A.T @ impulses, rtol=0, atol=1e-12)
