"""Thrusters and wheels that together make a wrench, at any pose of any base."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import scipy.optimize

from ffsm_controllers.allocation import ThrusterAllocation, WheelAllocation, moments, unit_moments
from ffsm_mj.errors import ControllerError
from tests.conftest import MJCF
from tests.scenes import FLOATING_BASES, HEAD, compile_paths


def effect_of(system, data, thrusters):
    """Generalised force of each thruster on the base dofs, per unit of its effort."""
    return moments(system.mj, data, unit_moments(system.mj))[thrusters][:, system.robot.base_dofs].T


@pytest.fixture(scope="module")
def hardware():
    """Allocation of the body-fixed one-way thrusters of a turned robot, its data, and the force on the base per effort."""
    system = compile_paths(MJCF / "ffsm_3dof_hardware.xml", {"object": MJCF / "box_1m.xml"})
    data = mujoco.MjData(system.mj)
    data.qpos[2] = 0.7
    mujoco.mj_forward(system.mj, data)
    thrusters = np.array([i for i in range(system.mj.nu) if system.mj.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_SITE])
    return ThrusterAllocation(system, thrusters), data, effect_of(system, data, thrusters)


def test_where_nnls_goes_round_in_circles_small_shares_decide(hardware, rng, monkeypatch):
    """Shares need not be the same where thrusters are redundant; each pushes only, and their sum is as close to the force.

    The weight on small shares is 1e-7 of the columns, and costs its square over that of the smallest singular value, here
    above the columns' length: 1e-14 where the force can be made. A millionth is what the code promises.
    """
    allocation, data, effect = hardware
    forces = np.insert(rng.uniform(-30.0, 30.0, (20, 3)), [2, 2, 2], 0.0, axis=1)
    exact = [allocation.efforts(data, force[:3], force[3:]) for force in forces]
    nnls, limits = scipy.optimize.nnls, []

    def circling(A, b, maxiter=None):
        limits.append(maxiter)
        if maxiter is None:
            raise RuntimeError("Maximum number of iterations reached.")
        return nnls(A, b, maxiter=maxiter)

    monkeypatch.setattr(scipy.optimize, "nnls", circling)
    for force, efforts in zip(forces, exact, strict=True):
        other = allocation.efforts(data, force[:3], force[3:])
        assert other.min() >= 0.0
        np.testing.assert_allclose(effect @ other, effect @ efforts, rtol=0, atol=1e-6 * np.linalg.norm(force))
    assert None in limits


def test_where_no_shares_are_found_the_controller_says_so(hardware, monkeypatch):
    allocation, data, _ = hardware

    def circling(*_, **__):
        raise RuntimeError("Maximum number of iterations reached.")

    monkeypatch.setattr(scipy.optimize, "nnls", circling)
    with pytest.raises(ControllerError, match="no shares of the thrusters"):
        allocation.efforts(data, np.ones(3), np.ones(3))


BASES = {
    **FLOATING_BASES,
    "rail": '<joint name="x" type="slide" axis="1 0 0"/><joint name="yaw" axis="0 0 1"/>',
    "skewed": """<joint name="a" type="slide" axis="1 1 0"/><joint name="b" type="slide" axis="0 1 1"/>
      <joint name="c" axis="0 0 1"/>""",
}
WHEELS = ("w1", "w2", "w3", "w4")


@pytest.fixture
def rig(tmp_path, rng):
    """Makes a robot with jets at random places of its base and of its arm, four wheels, and data at a random pose."""

    def make(base):
        sites = (
            f'<site name="{name}" pos="{numbers(rng.uniform(-1, 1, 3))}" euler="{numbers(rng.uniform(-180, 180, 3))}"/>'
            for name in "abcdefgh"
        )
        wheels = (
            f"""<body name="{name}" euler="{numbers(rng.uniform(-180, 180, 3))}"><joint name="{name}" axis="0 0 1"/>
            <inertial pos="0 0 0" mass="0.2" diaginertia="0.01 0.01 0.02"/></body>"""
            for name in WHEELS
        )
        jets = (f'<motor name="{name}" site="{name}" gear="1 0 0.2 0 0.1 0.3" ctrlrange="0 9"/>' for name in "abcdefgh")
        (tmp_path / "rig.xml").write_text(f"""<mujoco>{HEAD}<worldbody><body name="bus">{BASES[base]}
          <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>{"".join(sites)}{"".join(wheels)}
          <body name="arm" pos="0.5 0 0"><joint name="arm" axis="0 1 0"/>
            <inertial pos="0.2 0 0" mass="1" diaginertia="1 1 1"/><site name="tip" pos="0.3 0.1 0"/>
            <body name="far"><joint name="far" axis="1 0 1"/><geom size="0.1" mass="0.2"/></body>
          </body></body></worldbody>
          <actuator>{"".join(jets)}<motor name="tip" site="tip" gear="0 0 1 0 0 0" ctrlrange="-1 1"/>
          {"".join(f'<motor name="{name}" joint="{name}"/>' for name in (*WHEELS, "arm", "far"))}</actuator></mujoco>""")
        system = compile_paths(tmp_path / "rig.xml")
        data = mujoco.MjData(system.mj)
        mujoco.mj_integratePos(system.mj, data.qpos, rng.uniform(-2.0, 2.0, system.mj.nv), 1.0)
        mujoco.mj_forward(system.mj, data)
        return system, data

    return make


def numbers(values):
    return " ".join(map(str, values))


def base_forces(system, data, wrench):
    """Generalised forces of a wrench at the origin of the base's frame, world axes."""
    jacobian = np.empty((6, system.mj.nv))
    mujoco.mj_jacBody(system.mj, data, jacobian[:3], jacobian[3:], system.robot.root)
    return jacobian[:, system.robot.base_dofs].T @ wrench


@pytest.mark.parametrize("names", ["abcdefgh", "abc", ("a", "b", "tip")])
@pytest.mark.parametrize("base", BASES)
def test_nothing_comes_closer_to_the_wrench(rig, rng, base, names):
    """At any pose what the shares make is what non-negative least squares over the generalised forces there make.

    The point of a cone that is closest to another is unique, whatever the shares.
    """
    system, data = rig(base)
    thrusters, both = (
        np.array([system.index("actuator", name) for name in names]),
        np.array([name == "tip" for name in names]),
    )
    allocation = ThrusterAllocation(system, thrusters)
    for _ in range(20):
        mujoco.mj_integratePos(system.mj, data.qpos, rng.uniform(-1.0, 1.0, system.mj.nv), 1.0)
        mujoco.mj_forward(system.mj, data)
        wrench, effect = rng.uniform(-5.0, 5.0, 6), effect_of(system, data, thrusters)
        if not both.any():
            data.actuator_moment[:] = np.nan  # jets on the base need no more than its pose
        efforts = allocation.efforts(data, wrench[:3], wrench[3:])
        shares = scipy.optimize.nnls(np.hstack((effect, -effect[:, both])), base_forces(system, data, wrench))[0]
        best = shares[: len(names)]
        best[both] -= shares[len(names) :]
        np.testing.assert_allclose(effect @ efforts, effect @ best, rtol=0, atol=5e-12)
        assert np.all(efforts[~both] >= 0.0)
        if np.linalg.matrix_rank(effect) == len(names):  # then the shares are unique too
            np.testing.assert_allclose(efforts, best, rtol=0, atol=1e-10)


CORNERS = [(y, z) for y in (-0.3, 0.3) for z in (-0.2, 0.2)]


def mirrored(folder, base):
    """A cube with jets at the corners of its faces, along the edges: every jet has an image in each plane of symmetry."""
    axes = "0 1 0", "0 0 1"
    sites, motors = [], []
    for x, sign in ((-0.5, 1), (0.5, -1)):
        for k, (y, z) in enumerate(CORNERS):
            name = f"{'back' if sign > 0 else 'front'}{k}"
            sites.append(f'<site name="{name}" pos="{x} {y} {z}"/>')
            motors.append(f'<motor name="{name}" site="{name}" gear="{sign} 0 0 0 0 0" ctrlrange="0 9" ctrllimited="true"/>')
            for axis in axes:
                for turn in (1, -1):
                    side = f"{name}_{'y' if axis == axes[0] else 'z'}{'p' if turn > 0 else 'm'}"
                    gear = " ".join(str(turn * float(part)) for part in axis.split())
                    motors.append(
                        f'<motor name="{side}" site="{name}" gear="{gear} 0 0 0" ctrlrange="0 9" ctrllimited="true"/>'
                    )
    (folder / "cube.xml").write_text(f"""<mujoco>{HEAD}<worldbody><body name="bus">{BASES[base]}
      <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>{"".join(sites)}</body></worldbody>
      <actuator>{"".join(motors)}</actuator></mujoco>""")
    return compile_paths(folder / "cube.xml")


@pytest.mark.parametrize("base", ["free", "planar"])
def test_ties_between_mirror_images_are_broken_by_the_list_and_not_by_rounding(tmp_path, rng, base):
    """The same jets fire at poses that differ by rounding, and of two images that do the same the first of the list does."""
    system = mirrored(tmp_path, base)
    data, thrusters = mujoco.MjData(system.mj), np.arange(system.mj.nu)
    allocation = ThrusterAllocation(system, thrusters)
    wrenches = [np.eye(6)[i] * sign for i in range(6) for sign in (2.0, -2.0)] + [np.array((2.0, 1.0, 0, 0, 0, 0.3))]
    for wrench in wrenches:
        chosen = set()
        for _ in range(12):
            mujoco.mj_resetData(system.mj, data)
            mujoco.mj_integratePos(system.mj, data.qpos, 1e-15 * rng.normal(size=system.mj.nv), 1.0)
            mujoco.mj_forward(system.mj, data)
            chosen.add(tuple(np.flatnonzero(allocation.efforts(data, wrench[:3], wrench[3:]) > 1e-9).tolist()))
        assert len(chosen) == 1, wrench
    if base == "planar":  # jets that differ in height alone do the same
        for listed, expected in ((thrusters, ["back0", "back2"]), (thrusters[::-1], ["back3", "back1"])):
            efforts = ThrusterAllocation(system, listed).efforts(data, np.array((1.0, 0.0, 0.0)), np.zeros(3))
            fired = [system.mj.actuator(listed[i]).name.removeprefix("robot/") for i in np.flatnonzero(efforts > 1e-9)]
            assert fired == expected


@pytest.mark.parametrize("names", [WHEELS, WHEELS[:3], WHEELS[:2], ("w1", "far")])
def test_wheels_turn_the_base_as_asked_with_least_effort(rig, rng, names):
    """At any pose, redundant or too few: the torque on the base is minus the motors' about their axes."""
    system, data = rig("free")
    wheels = np.array([system.index("actuator", name) for name in names])
    joints = [system.index("joint", name) for name in names]
    allocation = WheelAllocation(system, wheels)
    for _ in range(20):
        mujoco.mj_integratePos(system.mj, data.qpos, rng.uniform(-1.0, 1.0, system.mj.nv), 1.0)
        mujoco.mj_forward(system.mj, data)
        torque = rng.uniform(-2.0, 2.0, 3)
        expected = np.linalg.pinv(-data.xaxis[joints].T) @ torque
        np.testing.assert_allclose(allocation.efforts(data, torque), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_an_ideal_wheel_gives_exactly_what_is_asked(case_study):
    """A motor on the base's own hinge, whose axis no pose turns."""
    data = mujoco.MjData(case_study.mj)
    allocation = WheelAllocation(case_study, np.array([case_study.index("actuator", "wheel")]))
    for yaw in np.linspace(0.0, 6.0, 50):
        data.qpos[2] = yaw
        mujoco.mj_forward(case_study.mj, data)
        assert allocation.efforts(data, np.array((0.0, 0.0, 1.1))).tolist() == [1.1]
