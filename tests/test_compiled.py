"""Every compiled twin against its original: the same inputs, the same outputs to the rounding of sums in another order."""

from __future__ import annotations

import ast
import hashlib
import inspect
import os
import pickle
import subprocess
import sys
from importlib.metadata import version

import mujoco
import numpy as np
import pytest
from ffsm_controllers.osdre.block_law import BlockLaw
from ffsm_controllers.osdre.planar_law import PlanarLaw
from ffsm_controllers.osdre.riccati import planar_riccati
from ffsm_controllers.osdre.riccati_doubling import Doubling, RiccatiError
from ffsm_controllers.osdre.riccati_planar import ACCEPTED_RESIDUAL, PlanarRiccati
from ffsm_controllers.osdre.tip_kinematics import TipKinematics

import ffsm_mj
from ffsm_mj import compiled
from ffsm_mj.actuation.limits import Envelope, Limits
from ffsm_mj.balance.joint_work import JointWork
from ffsm_mj.cli.main import main
from ffsm_mj.compiled import fastest, is_compiled
from ffsm_mj.contact_models.grasp import state_transfer as following
from ffsm_mj.contact_models.persistent.acceleration import ContactAcceleration
from ffsm_mj.contact_models.persistent.exchange import StageSums
from ffsm_mj.contact_models.persistent.friction.held_rows import HeldForces
from ffsm_mj.contact_models.persistent.friction.state import FrictionState
from ffsm_mj.contact_models.persistent.rows import RowEvaluator
from ffsm_mj.contact_models.persistent.smooth import Smooth
from ffsm_mj.contact_models.persistent.stage_forces import StageForces
from ffsm_mj.contact_models.persistent.steady import SteadyContacts
from ffsm_mj.dynamics.forced_stepper import ForcedStepper
from ffsm_mj.dynamics.free_stepper import WHOLE_STATE, FreeStepper
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.loop_stage import LoopStage
from ffsm_mj.errors import TwinsError
from ffsm_mj.records.sampler import Sampler
from tests.contact_models.grasp import scenes as capture
from tests.contact_models.grasp import two_hands as hands
from tests.scenes import compile_paths, scene

twins = pytest.importorskip("ffsm_mj_fast", reason="the extra 'fast' is not installed")
# Sums of at most ten products, each term of the size of the result or below.
ROUNDING = 1e-14
ARM = """<mujoco><option gravity="0 0 0" {options}/>
<default><geom type="capsule" fromto="0 0 0 .5 0 0" size=".05" mass="1"/></default>
<worldbody><body name="base"><freejoint name="free"/><geom fromto="-.2 0 0 .2 0 0" size="0.1" mass="5"/>
<body name="link_1" pos="0.2 0 0"><joint name="j1" axis="0 0 1" {joint}/><geom/>
<body name="link_2" pos="0.5 0 0"><joint name="j2" axis="0 1 0"/><geom/>
<body name="link_3" pos="0.5 0 0"><joint name="j3" axis="0 0 1"/><geom/><site name="tip" pos=".5 0 0"/>
</body></body></body></body></worldbody>{rest}</mujoco>"""
MOTORS = "<actuator>" + "".join(f'<motor name="m{i}" joint="j{i}"/>' for i in (1, 2, 3)) + "</actuator>"


@pytest.fixture(autouse=True)
def _switched_on(monkeypatch):
    monkeypatch.setenv("FFSM_COMPILED", "1")


def moving(system, rng):
    """Data at a random state, with random efforts."""
    data = mujoco.MjData(system.mj)
    mujoco.mj_integratePos(system.mj, data.qpos, rng.uniform(-1.0, 1.0, system.mj.nv), 1.0)
    data.qvel[:] = rng.uniform(-0.5, 0.5, system.mj.nv)
    data.ctrl[:] = rng.uniform(-2.0, 2.0, system.mj.nu)
    mujoco.mj_forward(system.mj, data)
    return data


def test_the_environment_decides(monkeypatch):
    assert is_compiled()
    assert fastest(FreeStepper) is twins.FreeStepper
    monkeypatch.setenv("FFSM_COMPILED", "0")
    assert not is_compiled()
    assert fastest(FreeStepper) is FreeStepper


def test_flight_is_the_same_to_the_last_bit(case_study, rng):
    """Skipping the stages that are current changes no bit of the motion, efforts changing at every step."""
    model, runs = case_study.mj, []
    efforts = rng.uniform(-2.0, 2.0, (200, model.nu))
    start = moving(case_study, rng)
    for kind in (FreeStepper, twins.FreeStepper):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        mujoco.mj_forward(model, data)
        state, momentum = np.empty(mujoco.mj_stateSize(model, WHOLE_STATE)), np.empty(model.nv)
        flight = kind(model, data, state, momentum)
        flight.clear(0.5)
        clear = []
        for effort in efforts:
            data.ctrl[:] = effort
            clear.append(flight.step(1e-3))
        runs.append(
            (data.qpos, data.qvel, data.qacc, state, data.site_xpos, clear, (flight.energy, flight.motion_bound, momentum))
        )
    for plain, twin in zip(runs[0][:-1], runs[1][:-1], strict=True):
        np.testing.assert_array_equal(plain, twin)
    assert True in clear
    assert False in clear
    np.testing.assert_allclose(np.hstack(runs[0][-1]), np.hstack(runs[1][-1]), rtol=ROUNDING)


def test_flight_notices_what_is_not_finite(case_study):
    """A motion that is not finite excludes no event, whatever the event bound."""
    for kind in (FreeStepper, twins.FreeStepper):
        data = mujoco.MjData(case_study.mj)
        flight = kind(
            case_study.mj, data, np.empty(mujoco.mj_stateSize(case_study.mj, WHOLE_STATE)), np.empty(len(data.qvel))
        )
        data.qvel[0] = np.nan
        flight.clear(np.inf)
        case_study.mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        assert not flight.step(1e-3)
        case_study.mj.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        assert np.isnan(flight.energy)


def test_joint_work(case_study, rng):
    model = case_study.mj
    on_joint, external = np.ones(model.nu), np.zeros(model.nu)
    on_joint[0], external[1] = 0.0, 1.0
    for held in (0.0, 1.0):
        data, accounts, pushed = moving(case_study, rng), (np.zeros(3), np.zeros(3)), []
        data.ctrl[:] *= held
        balances = [kind(data, on_joint, external, account) for kind, account in zip((JointWork, twins.JointWork), accounts)]  # noqa: B905
        for _ in range(20):
            pushed.append([each.open() for each in balances])
            mujoco.mj_step(model, data)
            mujoco.mj_forward(model, data)
            for each in balances:
                each.close()
        assert np.all(np.array(pushed) == (held > 0.0))
        np.testing.assert_allclose(*accounts, rtol=ROUNDING)
        assert (accounts[0][0] != 0.0) == (held > 0.0)


def test_sampler(case_study, rng):
    """The same lines, strided tables and arrays of any rank included."""
    model, root = case_study.mj, case_study.robot.root
    data, site = moving(case_study, rng), case_study.index("site", "tip")
    tables = []
    for kind in (Sampler, twins.Sampler):
        wide = np.full((4, model.nq + 8), np.nan)
        sampler = kind(model, data, base=root, tip=site)
        live = (data.qpos, sampler.twist[3:], data.xpos[root], sampler.jacp, data.subtree_linvel, np.zeros(0))
        own = [wide[:, 1 : 1 + model.nq], wide[:, -3:], *(np.zeros((4, *array.shape)) for array in live[2:])]
        sampler.copy(list(zip(live, own, strict=True)))
        for line in (2, 0):
            sampler.take(line)
            data.qpos[:] += 0.1
            mujoco.mj_forward(model, data)
        data.qpos[:] -= 0.2
        mujoco.mj_forward(model, data)
        tables.append([wide, *own])
    for plain, twin in zip(*tables, strict=True):
        np.testing.assert_allclose(plain, twin, rtol=0.0, atol=1e-15)


def test_sampler_refuses_what_it_cannot_copy(case_study):
    data = mujoco.MjData(case_study.mj)
    sampler = twins.Sampler(case_study.mj, data)
    for live, table in (
        (np.zeros(3), np.zeros((4, 2))),
        (np.zeros(3, dtype=np.float32), np.zeros((4, 3))),
        (np.zeros(6)[::2], np.zeros((4, 3))),
        (np.zeros(3), np.zeros((4, 6))[:, ::2]),
    ):
        with pytest.raises(ValueError, match="cannot copy"):
            sampler.copy([(live, table)])
    sampler.copy([(np.zeros(3), np.zeros((4, 3)))])
    with pytest.raises(IndexError, match="line 4 of a table of 4"):
        sampler.take(4)


def test_limits(rng):
    """Ranges, torque-speed lines, saturated wheels of either sign of gear, unpowered and not finite efforts."""
    count = 6
    for _ in range(300):
        envelope = Envelope(
            low=np.where(rng.random(count) < 0.5, -np.inf, -rng.random(count)),
            high=np.where(rng.random(count) < 0.5, np.inf, rng.random(count)),
            stall=np.where(rng.random(count) < 0.3, np.inf, rng.random(count)),
            slope=np.where(rng.random(count) < 0.5, 0.0, rng.normal(size=count)),
            saturation=np.where(rng.random(count) < 0.5, np.inf, rng.random(count)),
            gear=rng.choice([-2.0, 0.5, 1.0], count),
        )
        effort, powered, velocity = rng.normal(size=count), rng.random(count) < 0.7, rng.normal(size=count)
        if rng.random() < 0.2:
            effort[rng.integers(count)] = rng.choice([np.nan, np.inf])
        results = []
        for kind in (Limits, twins.Limits):
            table, ctrl = np.zeros((count, 4)), np.zeros(count)
            limits = kind(envelope, effort, powered, velocity, table, ctrl)
            with np.errstate(invalid="ignore"):
                done = limits.apply()
            results.append((done, table if done else table[:, 0], ctrl))
        for plain, twin in zip(*results, strict=True):
            np.testing.assert_array_equal(plain, twin)


def test_riccati_is_the_same_to_the_last_bit(rng, monkeypatch):
    """The very same source: warm, cold and failing starts, and no solution at all."""
    Q = np.diag([1.0, 2.0, 0.5, 0.7])
    twin = planar_riccati(Q)
    monkeypatch.setenv("FFSM_COMPILED", "0")
    plain = planar_riccati(Q)
    assert type(twin) is twins.PlanarRiccati
    assert type(plain) is PlanarRiccati
    A21, A22 = rng.normal(size=(2, 4))
    fallbacks = 0
    for tick in range(500):
        if tick % 100 == 0:
            A21, A22 = 30.0 * rng.normal(size=(2, 4))
        A21, A22 = A21 + 1e-3 * rng.normal(size=4), A22 + 1e-3 * rng.normal(size=4)
        angle = 1e-3 * tick
        args = tuple(A21.tolist()), tuple(A22.tolist()), (1.0, 10.0 ** -(tick % 7)), (np.cos(angle), np.sin(angle))
        first, second = plain.solve(*args), twin.solve(*args)
        assert first == second
        fallbacks += first[-1]
    assert 5 <= fallbacks < 250
    for solver in (plain, twin):
        with pytest.raises(RiccatiError):
            solver.solve((1.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0), (0.0, 0.0), (1.0, 0.0))


@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_doubling(p, rng):
    """Any number of outputs, near singular poses with corrections too; both give up on the same equation."""
    corrections = 0
    for case in range(150):
        A21, A22 = 10.0 ** (case % 5 - 2) * rng.normal(size=(2, p, p))
        B2 = rng.normal(size=(p, p + 1))
        B2[-1] *= 10.0 ** -(case % 6)
        S, root = B2 @ B2.T, rng.normal(size=(2 * p, 2 * p))
        Q = root @ root.T + 0.1 * np.eye(2 * p)
        plain, twin = Doubling(Q), twins.Doubling(Q)
        (expected, left), (K_lower, residual) = plain.solve(A21, A22, S), twin.solve(A21, A22, S)
        # Both end at rounding, of the largest entry: 3e-12 was the most in a thousand equations.
        np.testing.assert_allclose(K_lower, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())
        assert max(left, residual) <= 10.0 * ACCEPTED_RESIDUAL
        assert abs(plain.doublings - twin.doublings) <= 1
        corrections += twin.corrections
    assert corrections
    nothing = np.zeros((p, p))
    for kind in (Doubling, twins.Doubling):
        with pytest.raises(RiccatiError, match="no stabilising solution"):
            kind(np.eye(2 * p)).solve(np.eye(p), np.eye(p), nothing)
        with pytest.raises(RiccatiError, match="no stabilising solution"):
            kind(np.eye(2 * p)).solve(np.nan * np.eye(p), np.eye(p), np.eye(p))


def test_doubling_refuses_other_sizes():
    with pytest.raises(ValueError, match="blocks of another size than 3"):
        twins.Doubling(np.eye(6)).solve(np.eye(2), np.eye(2), np.eye(2))


@pytest.fixture(scope="module")
def spatial_arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "robot.xml"
    path.write_text(ARM.format(options="", joint="", rest=MOTORS))
    return compile_paths(path)


@pytest.mark.parametrize("whole_stack", [True, False])
@pytest.mark.parametrize("axes", [(0, 1), (1, 0), (0, 2), (2, 0), (2, 1)])
def test_planar_law(spatial_arm, rng, axes, whole_stack, monkeypatch):
    """Along a motion of an arm that moves in all directions."""
    model, data = spatial_arm.mj, moving(spatial_arm, rng)
    picked = np.eye(model.nv)[6:9]
    driven = np.vstack((picked, np.diag([1.0, 0.5, 2.0]) @ picked))
    laws = []
    for switch in "01":
        monkeypatch.setenv("FFSM_COMPILED", switch)
        kinematics = fastest(TipKinematics)(model, data, spatial_arm.index("site", "tip"), axes)
        solver = planar_riccati(np.diag([1.0, 1.0, 0.5, 0.5]))
        laws.append(fastest(PlanarLaw)(kinematics, data, solver, driven, axes, (3.0, 0.0), whole_stack))
    for _ in range(50):
        for law in laws:
            law.tick()
            assert law.report[1] <= ACCEPTED_RESIDUAL
        # Torques lose what the Riccati equation leaves, 2e-15, times the condition of S, some thousands.
        np.testing.assert_allclose(laws[0].effort, laws[1].effort, rtol=1e-11, atol=1e-12)
        kept = [0, 2, 3]  # the residual itself is rounding
        np.testing.assert_allclose(laws[0].report[kept], laws[1].report[kept], rtol=1e-11)
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)


@pytest.mark.parametrize("whole_stack", [True, False])
@pytest.mark.parametrize("axes", [(2,), (0, 1), (0, 1, 2), (2, 0, 1)])
def test_block_law(spatial_arm, rng, axes, whole_stack, monkeypatch):
    """Along a motion, at rest, and with torques that hardly move the output; the torques that do span the same space."""
    model, data, p = spatial_arm.mj, moving(spatial_arm, rng), len(axes)
    picked, target = np.eye(model.nv)[6:9], [3.0, 0.0, -1.0][:p]
    driven, laws = np.vstack((picked, np.diag([1.0, 0.5, 2.0]) @ picked)), []
    for switch in "01":
        monkeypatch.setenv("FFSM_COMPILED", switch)
        kinematics = fastest(TipKinematics)(model, data, spatial_arm.index("site", "tip"), axes)
        laws.append(fastest(BlockLaw)(kinematics, data, fastest(Doubling)(np.eye(2 * p)), driven, axes, target, whole_stack))
    assert type(laws[1]) is twins.BlockLaw
    for tick in range(50):
        if tick == 25:
            data.qvel[:] = 0.0
            mujoco.mj_forward(model, data)
        for law in laws:
            law.tick()
            assert law.report[1] <= ACCEPTED_RESIDUAL
        plain, twin = laws
        # What the Riccati equations leave, 1e-13 at most, times the condition of S, some hundreds.
        np.testing.assert_allclose(plain.effort, twin.effort, rtol=1e-9, atol=1e-10)
        kept = [0, -1]
        np.testing.assert_allclose(plain.report[kept], twin.report[kept], rtol=1e-11)
        np.testing.assert_allclose(plain.inputs.T @ plain.inputs, twin.inputs.T @ twin.inputs, rtol=0.0, atol=1e-12)
        assert plain.inputs.shape == (p, 3)
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "joint", "rest"),
    [
        ("", "", MOTORS),
        ("", "", ""),
        ('integrator="Euler"', "", MOTORS),
        ('integrator="implicitfast"', 'damping="5"', MOTORS),
        ("", 'frictionloss="0.5"', MOTORS),
        ("", 'range="-0.1 0.1" limited="true"', MOTORS),
        ("", "", MOTORS + '<equality><joint joint1="j1" joint2="j3"/></equality>'),
    ],
    ids=["free", "no motors", "Euler", "implicitfast", "friction", "limit", "equality"],
)
def test_what_is_not_conservative_is_the_same_too(tmp_path, options, joint, rest, monkeypatch):
    """Constraints and other integrators: where the stages cannot be skipped, they are not. To the last bit."""
    robot, runs = ARM.format(options=options, joint=joint, rest=rest), []
    path = scene(tmp_path, robot, {}, conservative=False, initial={"rates": {"robot/j1": 0.5, "robot/j2": 0.3}})
    for switch in "01":
        monkeypatch.setenv("FFSM_COMPILED", switch)
        run = ffsm_mj.run(path)
        runs.append(np.column_stack([run[key] for key in run.keys if key.startswith("state.")]))
    np.testing.assert_array_equal(*runs)


def test_twins_of_another_version_are_refused(monkeypatch):
    """With the way out."""
    compiled._twins.cache_clear()
    monkeypatch.setattr(compiled, "version", {"ffsm-mj": "2.0", "ffsm-mj-fast": "1.0"}.__getitem__)
    with pytest.raises(
        TwinsError, match=r"ffsm-mj-fast 1.0 does not fit ffsm-mj 2.0; build it again by: uv .* or set FFSM_COMPILED=0"
    ):
        fastest(FreeStepper)
    compiled._twins.cache_clear()


@pytest.mark.parametrize("kind", ["rigid", "ball", "hinge", "slide", "cylindrical"])
def test_rows_of_closed_loops(tmp_path, rng, kind):
    """Rows, rates, forces and drift of two latches, one of them dependent in part, at random states."""
    bench = hands.TwoHands(tmp_path, hands.SPATIAL, joints=("rigid", kind), objects=("target", "other"))
    model, data, latches = bench.system.mj, bench.data, [bench.latch("l"), bench.latch("r")]
    for _ in range(10):
        mujoco.mj_integratePos(model, data.qpos, 1e-3 * rng.normal(size=model.nv), 1.0)
        data.qvel[:], data.ctrl[:] = rng.normal(size=model.nv), rng.normal(size=model.nu)
        mujoco.mj_forward(model, data)
        combinations = [np.ascontiguousarray(each) for each in ClosedLoops(model, data, latches).weighted().independent()]
        both = [cls(model, data, latches, range(model.nbody), data) for cls in (LoopStage, twins.LoopStage)]
        pushed = []
        for stage in both:
            stage.combine(*combinations)
            stage.evaluate()
            data.qfrc_applied[:] = 1.0
            stage.push()
            pushed.append(data.qfrc_applied.copy())
            data.qfrc_applied[:] = 0.0
        one, other = both
        for name in ("J", "R", "response", "factor", "gamma", "y"):
            np.testing.assert_allclose(getattr(other, name), getattr(one, name), rtol=1e-12, atol=1e-11, err_msg=name)
        np.testing.assert_allclose(*pushed, rtol=0, atol=1e-11 * np.abs(pushed[0]).max())
        np.testing.assert_allclose(other.errors(), one.errors(), rtol=0, atol=1e-13)
        np.testing.assert_allclose(other.drift(), one.drift(), rtol=1e-12, atol=1e-13)
        assert other.fits() is one.fits() is True
        again = pickle.loads(pickle.dumps(other.__reduce__()[2]))
        np.testing.assert_array_equal(again[0], combinations[0])


PLAIN = (
    BlockLaw,
    ContactAcceleration,
    Doubling,
    ForcedStepper,
    FreeStepper,
    FrictionState,
    HeldForces,
    JointWork,
    Limits,
    LoopStage,
    PlanarLaw,
    PlanarRiccati,
    RowEvaluator,
    Sampler,
    Smooth,
    StageForces,
    StageSums,
    SteadyContacts,
    following.StateTransfer,
    TipKinematics,
)


def public_names(cls):
    """Methods with their arguments and attributes of a class, those that its methods assign included."""
    for base in cls.__mro__[:-1]:
        for node in ast.walk(ast.parse(inspect.getsource(base))):
            if isinstance(node, ast.FunctionDef) and (node.name == "__init__" or not node.name.startswith("_")):
                yield f"{cls.__name__}.{node.name}({', '.join(each.arg for each in node.args.args + node.args.kwonlyargs)})"
            elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and ast.unparse(node.value) == "self":
                if not node.attr.startswith("_"):
                    yield f"{cls.__name__}.{node.attr}"
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                yield f"{cls.__name__}.{node.target.id}"


def test_the_fingerprint_is_that_of_the_public_names():
    """A change of a public name requires a change of the twins: both packages then state the new fingerprint."""
    assert {cls.__name__ for cls in PLAIN} == {*twins.__all__} - {"INTERFACE"}
    names = sorted({name for cls in PLAIN for name in public_names(cls)})
    fingerprint = hashlib.sha256("\n".join(names).encode()).hexdigest()[:12]
    assert compiled.INTERFACE == twins.INTERFACE == fingerprint


@pytest.mark.parametrize("stated", ["", "0123456789ab"])
def test_twins_from_other_sources_are_refused(monkeypatch, capsys, stated):
    """In one line before the run starts, and not by an AttributeError within the run."""
    compiled._twins.cache_clear()
    monkeypatch.setattr(twins, "INTERFACE", stated)
    assert main(["run", "coasting", "-s", "duration_s=0.01", "--no-rerun"]) == 2
    assert capsys.readouterr().err == (
        f"the installed ffsm-mj-fast {version('ffsm-mj-fast')} is built from other sources than this ffsm-mj; "
        "build it again by: uv sync --inexact --extra fast --reinstall-package ffsm-mj-fast; or set FFSM_COMPILED=0\n"
    )
    compiled._twins.cache_clear()


def test_twins_that_need_a_name_that_is_gone_are_refused(monkeypatch):
    def import_of_an_old_build(_):
        raise AttributeError("module 'ffsm_mj.dynamics.free_stepper' has no attribute 'WHOLE_STATE'")

    compiled._twins.cache_clear()
    monkeypatch.setattr(compiled.importlib, "import_module", import_of_an_old_build)
    with pytest.raises(TwinsError, match=r"cannot be used \(AttributeError: .* uv sync --inexact --extra fast"):
        fastest(FreeStepper)
    compiled._twins.cache_clear()


@pytest.mark.long
def test_another_minor_version_of_mujoco_is_refused(tmp_path):
    """In one line, before a call by address; plain Python goes on."""
    program = (
        "import sys, mujoco; mujoco.mj_version, mujoco.__version__ = lambda: 4001002, '4.1.2'; "
        "from ffsm_mj.cli.main import main; sys.exit(main(['run', 'coasting', '-s', 'duration_s=0.01', '--no-rerun']))"
    )
    results = [
        subprocess.run(
            [sys.executable, "-c", program],
            cwd=tmp_path,
            env=os.environ | {"FFSM_COMPILED": switch},
            capture_output=True,
            text=True,
            check=False,
        )
        for switch in "10"
    ]
    refused, gone_on = results
    assert refused.returncode == 2
    assert refused.stderr.startswith(
        f"ffsm-mj-fast {version('ffsm-mj-fast')} cannot be used (ImportError: built for MuJoCo 4.0, not 4.1.2); "
        "build it again by: "
    )
    assert refused.stderr.count("\n") == 1
    assert gone_on.returncode == 0


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "seconds"), [("baseline", 12.0), ("spatial", 15.0)])
def test_whole_runs_agree(scenario, seconds, monkeypatch):
    """Impact and pause included: 1e-15 per tick, amplified a little by the feedback."""
    runs = []
    for switch in "01":
        monkeypatch.setenv("FFSM_COMPILED", switch)
        run = ffsm_mj.run(scenario, {"duration_s": seconds})
        runs.append(np.column_stack([run[key] for key in run.keys]))
    np.testing.assert_allclose(*runs, rtol=0.0, atol=1e-10, equal_nan=True)


@pytest.mark.parametrize("models", [(capture.ARM, capture.TARGET), (capture.FLAT_ARM, capture.FLAT_TARGET)])
def test_what_is_logged_follows_what_moves_alike(tmp_path, rng, monkeypatch, models):
    """Free joint, and slides with a hinge that has turned a few times; the twin is there, and gives the same to rounding."""
    runs, start = [], rng.bit_generator.state
    for way, kind in (("0", following.StateTransfer), ("1", twins.StateTransfer)):
        monkeypatch.setenv("FFSM_COMPILED", way)
        rng.bit_generator.state = start
        bench = capture.Bench(tmp_path, *models)
        bench.draw(rng)
        if models[0] is capture.FLAT_ARM:
            bench.data.qpos[-1] = 40.0
            mujoco.mj_forward(bench.model, bench.data)
        bench.capture()
        assert type(bench.held.followed) is kind
        for _ in range(20):
            bench.held.step(1e-3)
        data = bench.data
        runs.append((data.qpos, data.qvel, data.xpos, data.cvel, data.qfrc_bias, bench.motion.momentum, [data.time]))
    for plain, twin in zip(*runs, strict=True):
        np.testing.assert_allclose(plain, twin, rtol=0.0, atol=ROUNDING * (1.0 + np.abs(plain).max()))
