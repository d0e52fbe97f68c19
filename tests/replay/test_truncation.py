"""A check that fails by the truncation of the step alone says so; wrong physics put in on purpose never passes for that."""

from __future__ import annotations

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.impact.model import ImpactModel
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.pytest_plugin import assert_conserved
from ffsm_mj.replay import explain, replay_log
from ffsm_mj.replay.truncation import AnalysisLimits, _by_entry, _Refining, analyze_truncation
from ffsm_mj.verification.check_result import TRUNCATION_CHECKS
from ffsm_mj.verification.truncation import ENTRIES
from tests.scenes import scene
from tests.simulation.test_accuracy import whirling

ENOUGH = ("--truncation", "1000")
"""Time for a verdict whatever the load of this machine."""
SLIDER = """<mujoco><option gravity="0 0 0" integrator="RK4"/><worldbody>
<body name="base"><freejoint name="base"/><inertial pos="0 0 0" mass="10" diaginertia="1 1 1"/>
<body name="slider" pos="0.3 0 0"><joint name="j" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/><site name="tip" pos="0.1 0 0"/></body></body>
</worldbody><actuator><motor name="m" joint="j"/></actuator></mujoco>"""


def handle(name, spring=""):
    """A body of three moments of inertia with a site to grasp it by, and a flap on a spring if there is one."""
    flap = f"""<body name="flap" pos="0 0.1 0"><joint name="flap" axis="0 0 1" {spring}/>
<inertial pos="0 0.1 0" mass="0.5" diaginertia="0.002 0.003 0.004"/></body>"""
    return f"""<mujoco model="{name}"><option gravity="0 0 0" integrator="RK4"/><worldbody>
<body name="{name}"><freejoint name="free"/><inertial pos="0 0 0" mass="2" diaginertia="0.02 0.03 0.04"/>
<site name="handle"/>{flap if spring else ""}</body></worldbody></mujoco>"""


def failing(checks):
    return [check for check in checks if not check.passes]


def analysed(run):
    """Failing checks of a run, with a verdict whatever the load of this machine."""
    return failing(explain(run, limits=AnalysisLimits()).checks)


def replayed(run):
    """Failing checks from the states of a log, with a verdict."""
    return failing(explain(run, replay_log(run.log).checks(), limits=AnalysisLimits()).checks)


@pytest.fixture(scope="module")
def truncated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truncated")
    return ffsm_mj.run(whirling(folder), out=folder / "run", rerun=False)


@pytest.fixture(scope="module")
def found(truncated):
    """The analysis of its truncation."""
    return analyze_truncation(truncated.log, truncated.checks())


def test_the_residual_falls_with_the_fourth_power_and_says_so(truncated):
    broken = analysed(truncated)
    assert broken
    for check in broken:
        assert check.name in TRUNCATION_CHECKS
        assert check.fails_by_truncation
        # The fourth power gives 16; at 0.1 rad a step the next order still counts.
        assert 8.0 < check.truncation.residual / check.truncation.half < 32.0
        assert check.truncation.left + check.truncation.bound < check.tolerance
        assert "at 10 ms" in check.truncation.sentence(check.unit)
        assert "at 5 ms" in check.truncation.sentence(check.unit)


def test_run_and_log_say_the_same(truncated):
    again = {(check.name, check.subsystem): check for check in replayed(truncated)}
    for check in analysed(truncated):
        assert again[check.name, check.subsystem].truncation == check.truncation


def test_half_the_step_leaves_what_is_told(tmp_path, truncated):
    """The residual of another run at half the step: its states differ by truncation, so the two agree roughly."""
    half = {(check.name, check.subsystem): check for check in ffsm_mj.run(whirling(tmp_path, time_step_s=0.005)).checks()}
    for check in analysed(truncated):
        assert half[check.name, check.subsystem].residual == pytest.approx(check.truncation.half, rel=0.05)


def test_codes_summary_and_messages(truncated, capsys):
    folder = truncated.path.parent
    checks = json.loads((folder / "summary.json").read_text())["checks"]
    assert checks["fail_by_truncation"] is None  # a run from Python is analysed where it is asked for
    assert {check["truncation"] for check in checks["failing"]} == {"not analysed"}
    assert main(["analyze", str(folder), *ENOUGH]) == 5
    assert "truncation: " in capsys.readouterr().out
    again = folder / "again"
    assert main(["run", str(folder), "--out", str(again), "--no-rerun", *ENOUGH]) == 5
    assert "by the truncation of the step alone" in capsys.readouterr().err
    checks = json.loads((again / "summary.json").read_text())["checks"]
    assert not checks["passed"]
    assert checks["fail_by_truncation"] is True
    assert checks["failing"][0]["truncation"]["step_s"] == 0.01
    assert ffsm_mj.summary(truncated, explain(truncated, limits=AnalysisLimits()).checks)["checks"] == checks
    with pytest.raises(AssertionError, match=r"explain\(run\) finds whether by the truncation of the step alone"):
        assert_conserved(truncated)


def test_a_free_object_beside_a_grasped_one_keeps_its_residual(tmp_path):
    """One object is grasped at rest, another tumbles at 11 rad/s and 10 ms: its truncation is not the robot's.

    Its residuals at half the step are those of a run at half the step, whose states differ by truncation.
    """
    runs = (ffsm_mj.run(beside_a_grasped_one(tmp_path, step_s)) for step_s in (0.01, 0.005))
    broken, halved = ({(check.name, check.subsystem): check for check in analysed(run)} for run in runs)
    assert broken.keys() == {(name, of) for name in ("energy", "angular momentum") for of in ("total", "objects")}
    assert all(check.fails_by_truncation for check in broken.values())
    for key, check in halved.items():
        assert broken[key].truncation.half == pytest.approx(check.residual, rel=0.1)
    assert ("angular momentum", "objects") in halved


@pytest.mark.parametrize("gravity", [False, True], ids=["in space", "falling"])
@pytest.mark.parametrize("spring", ["", 'stiffness="3" damping="0.1"'], ids=["rigid", "springy"])
def test_residuals_of_steps_add_up_to_those_of_the_run(tmp_path, monkeypatch, gravity, spring):
    """By entry, with gravity on all, springs and dampers in the grasped object, a push of the arm, and a release."""

    def add_up(self, whole, *_):
        self._so_far[0] -= whole

    monkeypatch.setattr(_Refining, "_refine", add_up)
    run = ffsm_mj.run(beside_a_grasped_one(tmp_path, 0.01, gravity=gravity, spring=spring, released=True))
    assert len(run.records["releases"]) == 1
    broken = {(check.name, check.subsystem): check for check in failing(run.checks())}
    assert ("angular momentum", "objects") in broken
    steps = analyze_truncation(run.log, run.checks()).refined.half
    for check in steps.checks(()):
        # 70 steps, each of which rounds terms that cancel by some units in the last place, in the run and here.
        assert check.residual < 2 * 70 * 1e-15 * check.tolerance / 1e-9, check


def test_what_is_not_known_is_not_acquitted(truncated, found):
    """A residual that passes without truncation, but is not known to pass."""
    unsure = replace(found.refined, bounds=dict.fromkeys(found.refined.bounds, 1.0))
    doubtful = replace(found, refined=unsure).judged(truncated.checks(), 1e-9)
    assert {check.fails_by_truncation for check in failing(doubtful)} == {False}
    assert "known to 1.0e+00 J" in failing(doubtful)[0].truncation.sentence("J")


def beside_a_grasped_one(folder, step_s, *, gravity=False, spring="", released=False):
    tumbling = {"initial": {"joints": {"other/free": [4, 0, 0, 1, 0, 0, 0]}, "rates": {"other/free": [0, 0, 0, 8, 0.2, 8]}}}
    bodies = {"held": handle("held", spring), "other": handle("other")}
    robot = SLIDER
    if gravity:
        robot, *models = (text.replace('gravity="0 0 0"', 'gravity="0 -0.5 -1"') for text in (robot, *bodies.values()))
        bodies = dict(zip(bodies, models, strict=True))
    if spring:
        tumbling["initial"]["rates"]["held/flap"] = 1.0
    coast = {"name": "coast", "until": "end", "arm": ["grasp"], "controller": {"kind": "off"}}
    drop = {"name": "drop", "until": "end", "release": ["grasp"], "controller": {"kind": "off"}}
    push = {"kind": "pd", "joints": ["j"], "kp": 4.0, "kd": 2.0, "target": [0.3]}
    held = {"name": "push", "for_s": 0.4, "arm": ["grasp"], "controller": push}
    tumbling["initial"]["joints"]["held/free"] = [0.4, 0, 0, 1, 0, 0, 0]
    grasp = {"robot_site": "tip", "object_site": "held/handle", "when": {"within": {"position_m": 0.01}}}
    return scene(
        folder,
        robot,
        bodies,
        duration_s=0.7,
        conservative=not (gravity or spring),
        time_step_s=step_s,
        control_period_s=step_s,
        contacts={"rules": []},
        grasps={"grasp": grasp},
        phases=[held, drop] if released else [coast],
        **tumbling,
    )


@np.errstate(all="ignore")
@pytest.mark.parametrize("share", [1e-12, 3e-8])
@pytest.mark.parametrize("order", [1.0, 1.7, 2.0, 3.0, 4.0, 5.0])
def test_what_is_left_of_steps_is_known_to_their_bounds(order, share):
    """Residuals that fall with a power of the step, and the next one beside it, toward a limit that is not zero.

    A bound is that of a geometric series of the ratio seen last, which the next power changes by some percent; in one step
    of some tens two divisions agree by chance.
    """
    wrong, bounds = 0.0, 0.0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        limit, first, second = rng.normal(size=(3, 22)) * np.array([[1e-8], [1e-6], [1e-7]])
        whole = limit + first + second
        made = refining(lambda n, a=first, b=second, c=limit: c + a * n**-order + b * n ** -(order + 1.0), share)
        made._refine(whole, np.ones(10), 1e-3, 1e-3)
        wrong, bounds = wrong + _by_entry(made._so_far[1] + whole - limit), bounds + made._bound
    assert np.all(wrong < 1.1 * bounds + 0.05 * 40 * share)
    # Six halvings leave 2^-6p of order p, the last of them takes off 2^p - 1 times as much; the norm of three residuals of
    # 1e-6 is 1.6e-6 on average. What is left of order four and more is below the share of a step.
    assert np.all(bounds < 40 * max(share, 3e-6 * 2.0 ** (-6.0 * order) * (2.0**order - 1.0) if order < 4.0 else 0.0))


@np.errstate(all="ignore")
def test_what_grows_with_the_number_of_steps_is_not_known():
    """A leak at each step doubles with each halving; one at a rate stays as it is, and is no truncation."""
    each, rate = (refining(lambda n, power=power: np.full(22, 1e-8) * n**power) for power in (1.0, 0.0))
    for made in (each, rate):
        made._refine(np.full(22, 1e-8), np.ones(10), 1e-3, 1e-3)
    assert np.all(each._bound > 1e-7)
    assert np.all(np.abs(rate._so_far) < 1e-20)


@np.errstate(all="ignore")
def test_one_step_and_two_that_agree_by_chance_say_nothing():
    """Residuals of a step of a motion that is too fast for both, as measured: the finer ones fall to zero."""
    measured = {1.0: -2.179e-3, 2.0: -2.035e-3, 4.0: -1.549e-4, 8.0: -1.005e-5, 16.0: -6.328e-7}
    made = refining(lambda n: np.full(22, measured[n]), share=1e-3)
    made._refine(np.full(22, measured[1.0]), np.ones(10), 1e-3, 1e-3)
    assert np.all(_by_entry(made._so_far[1] + measured[1.0]) < made._bound + 1e-5)


def test_truncation_of_a_motion_that_is_far_too_fast_for_its_step_is_known(tmp_path):
    """At 280 rad/s in steps of 10 ms, 64 parts of a step leave more than what the checks allow."""
    run = ffsm_mj.run(whirling(tmp_path, rate=40.0, duration_s=0.04, contacts={"rules": []}))
    energy = next(check for check in run.checks() if not check.passes)
    assert energy.residual > 1e6 * energy.tolerance
    assert all(check.fails_by_truncation for check in analysed(run))


def test_a_method_of_lower_order_is_no_truncation(truncated, found):
    """Halvings take off what falls with the second power as well: all of it is gone without the step."""
    assert min(found.refined.orders.values()) > 3.5
    second = replace(found, refined=replace(found.refined, orders=dict.fromkeys(found.refined.orders, 2.0)))
    broken = failing(second.judged(truncated.checks(), 1e-9))
    assert {check.fails_by_truncation for check in broken} == {False}
    assert broken[0].truncation.sentence("J").endswith("; it falls with the power 2.0 of the step, truncation with 4")


@np.errstate(all="ignore")
@pytest.mark.parametrize("order", [1.0, 2.0, 3.0, 4.0])
def test_the_order_is_that_of_most_steps(order):
    """One step in four has a kink: its residual falls with the first power, and is ten times as large."""
    made = refining(lambda n: np.full(22, kink / n + 1e-7 * n**-power))
    for step in range(40):
        kink, power = (1e-6, 1.0) if step % 4 == 3 else (0.0, order)
        made._refine(np.full(22, kink + 1e-7), np.ones(10), 1e-3, 1e-3)
    assert set(made.orders) == set(ENTRIES)
    np.testing.assert_allclose([*made.orders.values()], order, atol=1e-3)


def refining(of_parts, share=1e-12):
    """An analysis of steps with given residuals at a number of divisions; a step may leave a share of them unknown."""
    made = object.__new__(_Refining)
    made._so_far, made._bound, made._spare = np.zeros((2, 22)), np.zeros(10), np.zeros((2, 10))
    made._powers = [[] for _ in ENTRIES]
    made._shares, made._step_s = np.full((2, 10), share), 1e-3
    made._back_to_start = lambda: None
    made._in_parts = lambda *given: of_parts(float(given[-1]))
    return made


def losing(share):
    """A motion that loses a share of all rates in each step: ``share(duration)``."""
    honest = Motion.step

    def step(self, duration_s):
        clear = honest(self, duration_s)
        self.data.qvel[:] *= 1.0 - share(duration_s)
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_mulM(self.model, self.data, self.momentum, self.data.qvel)
        return clear

    return step


# At rates of 10 rad/s truncation is 1e-5 J, what is allowed 2e-8 J: each leak is between the two, 1e-6 J or so.
@pytest.mark.long
@pytest.mark.parametrize(
    "share",
    [lambda h: 1e-7 * h, lambda h: 1e-9 + 0.0 * h, lambda h: 1e-3 * h * h],
    ids=["at a rate", "at each step", "of first order"],
)
@pytest.mark.parametrize("rate", [1.0, 0.1], ids=["with truncation", "without"])
def test_a_leak_is_no_truncation(tmp_path, monkeypatch, share, rate):
    monkeypatch.setattr(Motion, "step", losing(lambda h: share(h) / rate**2))
    path = whirling(tmp_path, rate=rate)
    assert main(["run", str(path), "--out", str(tmp_path / "run"), "--no-rerun"]) == 1
    run = ffsm_mj.load_run(tmp_path / "run")
    assert any(check.fails_by_truncation is False for check in analysed(run))
    assert any(check.fails_by_truncation is False for check in replayed(run))


def test_an_impulse_of_the_wrong_sign_is_no_truncation(tmp_path, monkeypatch):
    honest = ImpactModel.exchange

    def booking(self, energies, impact):
        true = honest(self, energies, impact)
        return Exchange(true.energy_J, -true.impulse, true.outside)

    monkeypatch.setattr(ImpactModel, "exchange", booking)
    start = {"shoulder": 0.3, "elbow": 0.9, "b/free": [1.1, 0.7, 0.2, 1, 0, 0, 0]}
    rates = {"shoulder": 4.0, "elbow": -7.0, "robot/free": [0.2, 0, 0, 1, 2, 3], "b/free": [-4, 0, 0, 3, 6, 2]}
    run = ffsm_mj.run(whirling(tmp_path, initial={"joints": start, "rates": rates}))
    assert run.impacts
    broken = analysed(run)
    assert all(check.fails_by_truncation for check in broken if check.name == "energy")
    assert any(check.fails_by_truncation is False for check in broken if check.name == "linear momentum")
