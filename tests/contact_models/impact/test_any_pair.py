"""Impact pairs of any two geoms: two objects, robot and object in either order, the robot with itself."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact.motion_bound import speeds_per_root_energy
from ffsm_mj.contact_models.impact.laws import FRICTIONLESS
from ffsm_mj.impact import Contact, contact_jacobian, reflect, resolve
from tests.replays import proved
from tests.scenes import CHAIN, ball, scene, self_hit, three_balls


def change_of(run, key):
    """Change of a column over the run."""
    return float(run[key][-1] - run[key][0])


def test_two_objects_head_on(tmp_path):
    """Closed form of 1.5 kg at 1 m/s against 4 kg at -0.25 m/s, e = 0.9; the robot passes without contact."""
    m, v, e = (1.5, 4.0), (1.0, -0.25), 0.9
    path = scene(
        tmp_path,
        ball("ball"),
        {"one": ball("one", mass=m[0], joints="x"), "two": ball("two", mass=m[1], joints="x")},
        initial={
            "joints": {"robot/free": [0, 5, 0, 1, 0, 0, 0], "two/x": 0.45},
            "rates": {"one/x": v[0], "two/x": v[1], "robot/free": [0.3, 0, 0, 0, 0, 0]},
        },
        contacts={"rules": [{"between": ["one/one", "two/two"], "restitution": e}]},
    )
    run = proved(ffsm_mj.run(path))
    (hit,) = run.impacts
    impulse = (1 + e) * (v[0] - v[1]) * m[0] * m[1] / sum(m)
    after = v[0] - impulse / m[0], v[1] + impulse / m[1]
    assert hit.time_s == pytest.approx(0.2, abs=1e-12)
    assert hit.impulse_N_s == pytest.approx(impulse, rel=1e-13)
    assert [hit.qvel_after[f"{name}/x"][0] for name in ("one", "two")] == pytest.approx(after, rel=1e-13)
    np.testing.assert_allclose(hit.normal, (1, 0, 0), atol=1e-15)
    # Energies and momenta are below 1 in SI units: rounding is some 1e-16.
    lost = 0.5 * (1 - e**2) * m[0] * m[1] / sum(m) * (v[0] - v[1]) ** 2
    assert hit.energy_change_J == pytest.approx(-lost, abs=1e-15)
    assert hit.linear_momentum_change_N_s < 1e-15
    assert (hit.pair, hit.geoms, hit.robot_geom, hit.object_geom) == ("one/one-two/two", ("one/one", "two/two"), "", "")
    # All of it is the objects'; nothing passes between the subsystems.
    assert change_of(run, "balance.objects_impact_energy_J") == pytest.approx(-lost, abs=1e-15)
    assert change_of(run, "balance.robot_impact_energy_J") == 0.0
    assert not run.log.rows[:, [run.keys.index(key) for key in run.keys if key.startswith("balance.contact_")]].any()


def test_robot_on_object_and_object_on_object(tmp_path):
    """Two impacts in a row by the closed form: only the first is between subsystems, both change the objects' energy."""
    run = proved(ffsm_mj.run(three_balls(tmp_path, CHAIN)))
    first, second = run.impacts
    handed = 1.8 * 1.0 * 2 * 3 / 5
    assert first.impulse_N_s == pytest.approx(handed, rel=1e-13)
    assert second.impulse_N_s == pytest.approx(1.5 * (handed / 3) * 3 / 4, rel=1e-13)
    assert [record.pair for record in run.impacts] == ["ball-left/left", "behind"]
    assert change_of(run, "balance.contact_P_x_N_s") == pytest.approx(handed, rel=1e-13)
    by_subsystem = [change_of(run, f"balance.{subsystem}_impact_energy_J") for subsystem in ("total", "robot", "objects")]
    assert by_subsystem[0] == pytest.approx(first.energy_change_J + second.energy_change_J, abs=1e-15)
    assert by_subsystem[1] == pytest.approx(first.energy_after_J["robot"][0] - first.energy_before_J["robot"][0], abs=1e-15)
    assert by_subsystem[0] == pytest.approx(by_subsystem[1] + by_subsystem[2], abs=1e-15)


def test_the_order_of_the_pair_does_not_matter(tmp_path):
    """``[object, robot]``: normal and impulse act on the robot; motion and balances are the same."""
    (tmp_path / "turned").mkdir()
    turned = [{"between": ["left/left", "ball"], "restitution": 0.8}, CHAIN[1]]
    run, other = (
        ffsm_mj.run(three_balls(tmp_path, CHAIN)),
        proved(ffsm_mj.run(three_balls(tmp_path / "turned", turned))),
    )
    one, two = run.impacts[0], other.impacts[0]
    np.testing.assert_allclose(two.normal, -np.array(one.normal), atol=1e-15)
    assert two.impulse_N_s == pytest.approx(one.impulse_N_s, rel=1e-14)
    assert (two.geoms, two.robot_geom) == (("left/left", "robot/ball"), "")
    for key in ("state.v_robot_x_m_s", "state.v_left_x_m_s", "balance.contact_P_x_N_s", "balance.robot_impact_energy_J"):
        np.testing.assert_allclose(other[key], run[key], atol=1e-14)


def test_all_three_at_once(tmp_path):
    """Robot on object and object on object at one instant: Newton's cradle of equal balls, one event, two contacts."""
    path = scene(
        tmp_path,
        ball("ball", joints="x"),
        {"left": ball("left", joints="x"), "right": ball("right", joints="x")},
        initial={"joints": {"left/x": 0.3, "right/x": 0.5}, "rates": {"robot/x": 1.0}},
        contacts={"rules": [{"between": ["ball", "left/left"]}, {"between": ["left/left", "right/right"]}]},
        duration_s=0.2,
    )
    run = proved(ffsm_mj.run(path))
    assert [(record.event, record.pair) for record in run.impacts] == [(0, "ball-left/left"), (0, "left/left-right/right")]
    # The contact of the two at rest is found as a closed gap of up to 1e-9 m, its velocities are exact to rounding.
    np.testing.assert_allclose([run[f"state.v_{n}_x_m_s"][-1] for n in ("robot", "left", "right")], (0, 0, 1), atol=1e-14)
    assert change_of(run, "balance.contact_P_x_N_s") == pytest.approx(1.0, abs=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("pair", [("hull", "tip"), ("tip", "hull")])
@pytest.mark.parametrize("restitution", [0.0, 0.6, 1.0])
def test_the_robot_hits_itself(tmp_path, pair, restitution):
    run = proved(ffsm_mj.run(self_hit(tmp_path, pair=pair, restitution=restitution)))
    hit = run.impacts[0]
    assert hit.geoms == tuple(f"robot/{name}" for name in pair)
    assert hit.robot_geom == hit.object_geom == ""
    assert hit.separation_speed_m_s == pytest.approx(restitution * hit.approach_speed_m_s, abs=1e-14)
    # Momenta of some 7 kg at 0.4 m/s, levers of 0.5 m: their changes are rounding of those, 1e-16 times a few.
    assert hit.linear_momentum_change_N_s < 1e-14
    assert hit.angular_momentum_change_N_m_s < 1e-14
    # What an impulse I does along a normal at which the speeds are u and u': I (u + u') / 2.
    work = 0.5 * hit.impulse_N_s * (hit.separation_speed_m_s - hit.approach_speed_m_s)
    assert hit.impulse_N_s > 0.05
    assert hit.energy_change_J == pytest.approx(work, abs=1e-14)
    assert change_of(run, "balance.robot_impact_energy_J") == pytest.approx(
        sum(r.energy_change_J for r in run.impacts), abs=1e-14
    )
    assert change_of(run, "balance.objects_impact_energy_J") == pytest.approx(
        0.0, abs=1e-15
    )  # T less the robot's share of it
    assert not np.column_stack([run[key] for key in run.keys if key.startswith("balance.contact_")]).any()


def test_at_the_impact_the_arm_touches_its_base(tmp_path):
    """The time from the kinematics alone: the ball at the tip is 0.05 m above the hull's face of 0.2 m."""
    run = ffsm_mj.run(self_hit(tmp_path))
    system, hit = prepare(tmp_path / "scene.yaml").system, run.impacts[0]
    data = mujoco.MjData(system.mj)
    data.qpos[:] = hit.qpos
    mujoco.mj_kinematics(system.mj, data)
    base, tip = (system.index("body", "base"), system.index("geom", "tip"))
    height = (data.xmat[base].reshape(3, 3).T @ (data.geom_xpos[tip] - data.xpos[base]))[1]
    assert height == pytest.approx(0.25, abs=1e-13)
    np.testing.assert_allclose(hit.normal, data.xmat[base].reshape(3, 3)[:, 1], atol=1e-14)


def test_an_arm_presses_on_its_own_base(tmp_path):
    """The elbow's motor holds the tip on the hull: the bounces die out, the tip stays, slides over the edge and leaves."""
    law = {"kind": "pd", "joints": ["elbow"], "kp": 4.0, "kd": 2.0, "target": [3.0]}
    phases = [{"name": "press", "until": "end", "controller": law}]
    run = ffsm_mj.run(self_hit(tmp_path, restitution=0.3, phases=phases, duration_s=2.0))
    assert run.outcome == "completed"
    (begins,), (ends,) = run.records["contact_beginnings"], run.records["contact_endings"]
    (slides,) = run.records["contact_changes"]
    assert (begins.pair, begins.mode, slides.mode) == ("hull-tip", "sphere on face", "sphere on edge")
    assert begins.time_s < slides.time_s < ends.time_s
    # The normal turns there without a jump: no velocity changes. The force jumps, for a corner that is passed bends the way.
    for joint, before in slides.qvel_before.items():
        np.testing.assert_allclose(slides.qvel_after[joint], before, atol=1e-9)
    assert slides.force_after_N < 0.5 * slides.force_before_N
    # The hull and the tip are of one subsystem: but for the rounding that was taken out of the gap, nothing leaves it.
    assert np.abs(np.column_stack([run[key] for key in run.keys if key.startswith("balance.contact_P")])).max() < 1e-15
    assert all(check.passes for check in all_checks(run)), [law for check in all_checks(run) if not check.passes]
    assert len(run.impacts) > 2
    assert [law for check in all_checks(run) if not check.passes] == []
    assert np.ptp(run["momentum.total_L_z_N_m_s"]) < 1e-11  # a motor at a joint and the contact are both within the robot


def test_one_contact_has_one_closed_form(rng):
    """The map of one contact agrees with every law, for any masses, directions and restitutions up to 1."""
    for _ in range(200):
        root = rng.normal(size=(5, 5)) + 3.0 * np.eye(5)
        M, row, v, e = root @ root.T, rng.normal(size=5), rng.normal(size=5), rng.uniform()
        row = row if row @ v < 0.0 else -row
        after, impulse = reflect(M, row, v, e)
        assert row @ after == pytest.approx(-e * (row @ v), abs=1e-12)
        L = np.linalg.cholesky(M)
        for law in FRICTIONLESS.values():
            result = law(np.linalg.solve(L, row)[None], L.T @ v, np.array([e]))
            # Condition numbers reach some 1e3, so 1e-13 of what is compared is left.
            assert result.impulses[0] == pytest.approx(impulse, rel=1e-11)
            np.testing.assert_allclose(np.linalg.solve(L.T, result.w), after, atol=1e-11)


def test_a_normal_through_the_hinge_takes_no_part(tmp_path, rng):
    """A contact that cannot approach has a row of zeros, not a row of rounding with an impulse of 1e16 N s.

    Other contacts have the impulses that they have without it, with friction at either and with none.
    """
    system = prepare(self_hit(tmp_path)).system
    model, data = system.mj, mujoco.MjData(system.mj)
    upper, lower = system.index("body", "upper"), system.index("body", "lower")
    for _ in range(50):
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-2, 2, model.nv), 1.0)
        data.qvel[:] = rng.uniform(-1, 1, model.nv)
        mujoco.mj_forward(model, data)
        axis = data.xanchor[system.mj.joint("robot/elbow").id]
        normal = data.xmat[lower].reshape(3, 3) @ (np.cos(1.0), np.sin(1.0), 0.0)
        stuck = Contact(upper, lower, axis + 0.3 * normal, normal)
        row = contact_jacobian(model, data, stuck)
        assert not row.any()
        with pytest.raises(ValueError, match="neither body can move along the contact normal"):
            reflect(np.eye(model.nv), row, data.qvel)
        rocks = [Contact(lower, system.objects[0].root, axis + 0.1 * each, normal, 0.5) for each in np.eye(3)[:2]]
        for others in (rocks[:1], rocks):
            for mu, own_mu in ((0.0, 0.0), (0.3, 0.0), (0.3, 0.5), (0.0, 0.5)):
                rough = [replace(each, mu=mu) for each in others]
                alone = resolve(model, data, rough)
                found = resolve(model, data, [replace(stuck, mu=own_mu), *rough])
                assert not found.vectors[0].any()
                # Impulses and velocities are of the order of 1; a friction law is solved to 1e-9.
                np.testing.assert_allclose(found.vectors[1:], alone.vectors, rtol=0, atol=1e-8)
                np.testing.assert_allclose(found.after.qvel, alone.after.qvel, rtol=0, atol=1e-8)
        assert not resolve(model, data, [replace(stuck, mu=0.5)]).vectors.any()


def test_energy_bounds_the_closing_speed_of_a_robot_with_itself(tmp_path, rng):
    """The fastest approach for an energy, sqrt(2 T J M^-1 J^T), is within the bound, which exceeds it at most 2.5 times."""
    assembly = prepare(self_hit(tmp_path)).assemble()
    model, data, (pair,) = assembly.system.mj, mujoco.MjData(assembly.system.mj), assembly.pairs
    shares = []
    for _ in range(300):
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-3, 3, model.nv), 1.0)
        mujoco.mj_forward(model, data)
        near = pair.proximity(model, data)
        if near.gap <= 0.0:
            continue
        contact = Contact(pair.body_a, pair.body_b, near.points[0], near.normal)
        row = contact_jacobian(model, data, contact)
        M = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        shares.append(np.sqrt(row @ np.linalg.solve(M, row)) / speeds_per_root_energy(model, data, [pair])[0])
    assert 0.4 < max(shares) <= 1.0
