"""Time and state of an impact within a step: closed forms, grid points, several impacts, grazes, thin plates."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj._core.steppers import WHOLE_STATE
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact.motion_bound import speeds_per_root_energy
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.first_touch import first_touch
from ffsm_mj.contact_models.impact.time_of_impact import Clearances, Detector
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.step_path import StepPath
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from tests.scenes import HEAD, ball, box, compile_paths, scene, two_balls


@pytest.mark.parametrize("step", [0.001, 0.01])
@pytest.mark.parametrize("speed", [0.3, 7.7, 240.0])
def test_two_balls_meet_at_the_closed_form_time(tmp_path, speed, step):
    """Time = gap / speed. The clock resolves 1e-16 relative, the root is found to 1e-14 m."""
    run = ffsm_mj.run(two_balls(tmp_path, speed=speed, duration_s=1.2, time_step_s=step, control_period_s=step))
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(0.3 / speed, abs=1e-13)
    assert abs(impact.gap_m) < 1e-9
    # 2 kg on 3 kg, elastic: (m1 - m2)/(m1 + m2), 2 m1/(m1 + m2).
    assert impact.qvel_after["robot/x"][0] == pytest.approx(-0.2 * speed, rel=1e-13)
    assert impact.qvel_after["target/x"][0] == pytest.approx(0.8 * speed, rel=1e-13)


def test_impact_on_a_grid_point(tmp_path):
    """0.25 m at 0.5 m/s: exactly at the end of a step, once."""
    run = ffsm_mj.run(two_balls(tmp_path, speed=0.5, gap=0.25, duration_s=1.0, time_step_s=0.125, control_period_s=0.125))
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(0.5, abs=1e-12)


def test_touching_and_approaching_at_the_start(tmp_path):
    """An impact at t = 0 precedes any motion; the first row is the state before it."""
    run = ffsm_mj.run(two_balls(tmp_path, gap=0.0, duration_s=0.1))
    (impact,) = run.impacts
    assert impact.time_s == 0.0
    assert run["state.v_robot_x_m_s"][0] == 1.0
    assert run["state.v_target_x_m_s"][-1] == pytest.approx(0.8, rel=1e-14)
    assert all(check.passes for check in all_checks(run, 1e-13))


def test_touching_and_separating_is_no_impact(tmp_path):
    run = ffsm_mj.run(two_balls(tmp_path, gap=0.0, speed=-1.0, duration_s=0.1))
    assert run.impacts == ()


def test_two_impacts_in_one_step(tmp_path):
    """A ball between two that approach from both sides: hit twice within one 10 ms step, each at its own time."""
    path = scene(
        tmp_path,
        ball("ball", mass=1.0, joints="x"),
        {"left": ball("left", mass=1.0, joints="x"), "right": ball("right", mass=1.0, joints="x")},
        duration_s=0.02,
        time_step_s=0.01,
        control_period_s=0.01,
        initial={"joints": {"left/x": -0.202, "right/x": 0.205}, "rates": {"left/x": 1.0, "right/x": -1.0}},
        contacts={
            "rules": [
                {"between": ["robot/ball", "left/left"]},
                {"between": ["robot/ball", "right/right"]},
            ]
        },
    )
    run = ffsm_mj.run(path)
    # Equal masses exchange velocities: at 2 ms the middle one takes off at 1 m/s and meets the right one at 3.5 ms.
    assert [impact.time_s for impact in run.impacts[:2]] == pytest.approx([0.002, 0.0035], abs=1e-13)
    assert [impact.object_geom for impact in run.impacts[:2]] == ["left/left", "right/right"]
    assert [impact.event for impact in run.impacts[:2]] == [0, 1]
    assert all(check.passes for check in all_checks(run, 1e-13))


@pytest.mark.parametrize(("offset", "hits"), [(0.2 - 1e-6, 1), (0.2 + 1e-9, 0), (0.2 + 1e-6, 0)])
def test_a_graze_is_neither_missed_nor_invented(tmp_path, offset, hits):
    """A ball that passes another at almost the sum of the radii, both inside one step."""
    path = scene(
        tmp_path,
        ball("ball", joints="xy"),
        {"target": ball("target", joints="xy")},
        duration_s=0.4,
        time_step_s=0.02,
        control_period_s=0.02,
        initial={"joints": {"target/x": 1.003, "target/y": offset}, "rates": {"robot/x": 5.0}},
        contacts={"rules": [{"between": ["ball", "target/target"]}]},
    )
    run = ffsm_mj.run(path)
    assert len(run.impacts) == hits
    if hits:
        # Touch where the centres are 0.2 m apart.
        assert run.impacts[0].time_s == pytest.approx((1.003 - np.sqrt(0.2**2 - offset**2)) / 5.0, abs=1e-12)


@pytest.mark.parametrize("speed", [10.0, 100.0, 1000.0])
@pytest.mark.parametrize("step", [0.001, 0.01])
def test_no_tunnelling_through_a_thin_plate(tmp_path, speed, step):
    """A 20 mm ball and a 1 mm plate: at 1000 m/s a 10 ms step covers ten metres."""
    path = scene(
        tmp_path,
        ball("ball", radius=0.01, joints="x"),
        {"plate": box("plate", mass=100.0, half=(0.0005, 0.3, 0.3))},
        duration_s=max(step, round(2.0 / speed / step) * step),
        time_step_s=step,
        control_period_s=step,
        initial={"joints": {"plate/free": [1.0105, 0.01, -0.02, 1, 0, 0, 0]}, "rates": {"robot/x": speed}},
        contacts={"rules": [{"between": ["ball", "plate/plate"]}]},
    )
    run = ffsm_mj.run(path)
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(1.0 / speed, abs=1e-12)


def test_time_step_survives_an_exception(case_study):
    """A Ctrl-C during event localisation leaves the time step of the model unchanged."""
    data = mujoco.MjData(case_study.mj)
    path = StepPath(case_study.mj, data)
    mujoco.mj_getState(case_study.mj, data, path.start, WHOLE_STATE)
    data.ctrl = np.zeros(case_study.mj.nu)

    def interrupt(*_):
        raise KeyboardInterrupt

    mujoco.set_mjcb_control(interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            path.move_to(1e-5)
    finally:
        mujoco.set_mjcb_control(None)
    assert case_study.mj.opt.timestep == 1e-3


@pytest.mark.parametrize("step", [0.01, 0.005, 0.002, 0.001])
def test_coasting_impact_does_not_depend_on_the_step(coasting_reference, step):
    """RK4 at 10 ms leaves 1e-11 over these 5 s; event localisation adds nothing."""
    run = ffsm_mj.run("coasting", {"time_step_s": step})
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(coasting_reference.time_s, abs=1e-9)
    for joint, rate in impact.qvel_after.items():
        assert rate[0] == pytest.approx(coasting_reference.qvel_after[joint][0], abs=1e-9)


@pytest.fixture(scope="module")
def coasting_reference():
    return ffsm_mj.run("coasting", {"time_step_s": 0.0005}).impacts[0]


SPIN = 50.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A ball with a knob, so that its spin matters, and a thin free plate."""
    folder = tmp_path_factory.mktemp("tunnel")
    (folder / "ball.xml").write_text(f"""<mujoco>{HEAD}<worldbody><body name="ball"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="0.1" diaginertia="1e-5 1e-5 1e-5"/>
      <geom name="ball" type="ellipsoid" size="0.01 0.008 0.009" mass="0"/></body></worldbody></mujoco>""")
    (folder / "plate.xml").write_text(box("plate", mass=10.0, half=(0.0005, 0.3, 0.3)))
    system = compile_paths(folder / "ball.xml", {"plate": folder / "plate.xml"})
    return system, mujoco.MjData(system.mj)


def touch_of_plate(system, data, speed, step, offset, *, start=0.0):
    """Time at which the ball touches the plate, integrated in steps from a start time."""
    pair = ContactPair(system, "hit", "ball", "plate/plate", 1.0)
    mujoco.mj_resetData(system.mj, data)
    x = -0.25 * min(speed, 20.0) + speed * start
    data.qpos[:7] = (x, offset[0], offset[1], 1, 0, 0, 0)
    # Isotropic inertia: the spin is constant and its angle known.
    turn = SPIN * start
    data.qpos[3:7] = (np.cos(turn / 2), 0, 0.6 * np.sin(turn / 2), 0.8 * np.sin(turn / 2))
    data.qvel[:6] = (speed, 0, 0, 0, 0.6 * SPIN, 0.8 * SPIN)
    mujoco.mj_forward(system.mj, data)
    course = EventDrivenIntegrator(Motion(system.mj, data), [Detector(Scene(system, data), [pair])])
    time = start
    while time < start + 0.3:
        elapsed, contact_model = course.advance(step)
        if contact_model is not None:
            return time + elapsed
        time += step
    return None


@pytest.mark.long
@pytest.mark.parametrize("speed", [1000.0, 100.0, 10.0])
@pytest.mark.parametrize("score", range(10))
def test_the_same_touch_at_any_step_and_offset(flight, speed, score):
    system, data = flight
    rng = np.random.default_rng([20240601, score])
    for _ in range(20):
        offset = rng.uniform(-0.29, 0.29, 2)
        found = [touch_of_plate(system, data, speed, step, offset) for step in (0.001, 0.005, 0.01)]
        assert None not in found, offset
        start = np.floor((min(found) - 2e-4) / 1e-5) * 1e-5
        reference = touch_of_plate(system, data, speed, 1e-5, offset, start=max(start, 0.0))
        assert found == pytest.approx(3 * [reference], abs=1e-9)


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_just_past_the_edge_there_is_no_impact(flight, step):
    """20 mm of ball, 0.3 m of half plate: at 0.311 m it passes, at any speed."""
    system, data = flight
    for speed in (10.0, 1000.0):
        assert touch_of_plate(system, data, speed, step, (0.3105, 0.0)) is None


ROUNDING = 1e-14


def path(gap, slope):
    """A pair whose gap is a polynomial of time, and the times at which it was evaluated."""
    looked = []

    def at(time):
        looked.append(time)
        normal = np.array([1.0, 0.0, 0.0])
        rates = np.array([float(slope(time))])
        return Proximity(float(gap(time)), normal, np.zeros((1, 3)), rates, rate_tolerance=1e-12, rounding=ROUNDING)

    return at, looked


def touch(coefficients, *, pressed=False, span=(0.0, 1.0)):
    """First touch for the polynomial with these coefficients, highest power first."""
    gap = np.poly1d(coefficients)
    at, looked = path(gap, gap.deriv())
    found = first_touch(at, *span, lambda _: pressed)
    assert len(looked) < 250
    return found


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ([-1.0, 0.25], 0.25),  # straight in
        ([1.0, 0.25], None),  # straight out
        ([4.0, -4.0, 0.99], 0.45),  # a dip: (2 t - 1)^2 - 0.01, on the way down
        ([4.0, -4.0, 1.01], None),  # a graze that does not touch
        ([-1.0, 0.5, 0.0], 0.5),  # leaves a contact and comes back
        ([-1.0, 0.5, 1e-16], 0.5),  # the same from a gap at rounding level, not at its own start
        ([-1.0, 0.5, -1e-15], 0.5),  # and from below: back at the gap that it left
        ([-1.0, 0.0], 0.0),  # closed and approaching: at once
        ([1.0, 0.0], None),  # closed and leaving
        ([0.0], None),  # closed and still
        ([-1e-13, 0.0, 0.0], None),  # fallen by less than a hundred times rounding: still
    ],
)
def test_first_touch(coefficients, expected):
    """The root is accurate to the rounding of the gap over its slope there, which is at least 0.1."""
    found = touch(coefficients)
    assert found is None if expected is None else found == pytest.approx(expected, abs=10.0 * ROUNDING + 1e-13)


def test_pressed_from_rest_and_not():
    """Closed, at rest and falling: at once if it is pressed, else when it has fallen by a hundred times the rounding."""
    assert touch([-1.0, 0.0, 0.0], pressed=True) == 0.0
    assert touch([-1.0, 0.0, 0.0]) == pytest.approx(np.sqrt(100.0 * ROUNDING), rel=0.01)


def test_two_extrema_are_bisected():
    """A closed pair rises, falls below, and rises again: 20 t^3 - 27 t^2 + 8 t touches first at 0.4393 s."""
    first = (27.0 - np.sqrt(27.0**2 - 4.0 * 20.0 * 8.0)) / 40.0
    gap = np.poly1d([20.0, -27.0, 8.0, 0.0])
    end = 0.85  # still below, rising already
    assert gap(end) < 0.0 < gap.deriv()(end)
    assert touch(gap.coefficients, span=(0.0, end)) == pytest.approx(first, abs=1e-13)


def test_an_overlap_at_the_end_is_not_looked_at_again():
    """A query there is wrong by 1e-7 m at most, which leaves the first root of 1e-4 - 0.3 t - 5 t^2 + 40 t^3."""
    gap = np.poly1d([40.0, -5.0, -0.3, 1e-4])
    expected = min(root.real for root in gap.roots if root.real > 0.0)
    for error in (-1e-7, 0.0, 1e-7):
        at, looked = path(gap, gap.deriv())
        found = first_touch(at, 0.0, 1e-3, lambda _: False, gap(1e-3) + error)
        assert found == pytest.approx(expected, abs=10.0 * ROUNDING)  # over a slope of 0.3
        # The parabola leaves 40 t^3 of the gap, or the error of the query; inverse interpolation leaves rounding of it.
        assert len(looked) <= 4
        assert 1e-3 not in looked


@pytest.mark.parametrize("start", np.linspace(0.0, 1.5e-3, 16))
def test_a_touch_does_not_depend_on_where_the_search_begins(start):
    """Thin pieces are looked for in shorter parts of a step than thick ones: both touch at the same time."""
    place, speed = 1.6e-3, 0.16
    gap = np.poly1d([-400.0, 12.0, -speed, 0.0])
    at, _ = path(lambda time: gap(time - place), lambda time: gap.deriv()(time - place))
    found = first_touch(at, start, 2e-3, lambda _: False)
    # To a tenth of the rounding: the first value within all of it is up to that much away, from every third start.
    assert found == pytest.approx(place, abs=0.1 * ROUNDING / speed)


@pytest.mark.parametrize(
    ("gap", "rate", "approaches"),
    [(0.0, -1e-11, True), (0.0, -1e-13, False), (0.0, 1e-11, False), (-1e-10, -1e-13, True), (-1e-10, -1e-16, False)],
)
def test_a_slow_approach_counts_in_penetration(gap, rate, approaches):
    """5e-13 m/s is rounding in contact, but would be an overlap of 1e-9 m after half an hour."""
    near = Proximity(
        gap, np.array([1.0, 0.0, 0.0]), np.zeros((1, 3)), np.array([rate]), rate_tolerance=1e-12, rounding=ROUNDING
    )
    assert near.approaches == approaches


@pytest.mark.parametrize("level", [0.0, 3e-13])
def test_a_gap_that_stays_at_rounding_and_then_falls_at_once(level):
    """The gap of a cap that falls flat has a kink: regula falsi alone stops 1e-7 s past it after all its iterations."""
    kink, speed = 7.5e-5, 0.27
    at, looked = path(lambda t: min(level, level - speed * (t - kink)), lambda t: 0.0 if t < kink else -speed)
    found = first_touch(at, 0.0, 5e-4, lambda _: False)
    assert found == pytest.approx(kink + level / speed, abs=1e-11)
    assert len(looked) < 250


def test_a_fall_within_an_instant_of_the_start_is_rounding():
    """From 0 s on halves never end: a thousand lead to the least number."""
    at, looked = path(lambda time: -1e-9 if time > 0.0 else 0.0, lambda _: 1.0)
    assert first_touch(at, 0.0, 1e-3, lambda _: False) is None
    assert len(looked) < 250


def test_a_pair_apart_by_rounding_that_ends_in_contact_by_rounding_does_not_touch():
    """It must fall by more than rounding to touch again, whether it starts closed or apart by less than that."""
    assert touch([-1.7e-14, 1e-14, 5e-15]) is None
    assert touch([-1.7e-14, 1e-14, 0.0]) is None


FINGERS, KNOBS = 6, 5


@pytest.fixture(scope="module")
def hand(tmp_path_factory):
    """A heavy base with fingers of a gram on hinges and slides, and a rock with knobs: 30 pairs."""
    folder = tmp_path_factory.mktemp("hand")
    fingers = "".join(
        f"""<body name="finger{i}" pos="{0.1 * i - 0.25} 0 0.2"><joint name="finger{i}" {kind} axis="0 1 0"/>
        <geom name="finger{i}" type="capsule" fromto="0 0 0 0 0 0.15" size="0.01" mass="0.001"/></body>"""
        for i, kind in enumerate(("", 'type="slide"') * (FINGERS // 2))
    )
    (folder / "hand.xml").write_text(f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="50" diaginertia="5 5 5"/>{fingers}</body></worldbody></mujoco>""")
    knobs = "".join(f'<geom name="knob{i}" size="0.04" pos="{0.1 * i - 0.2} 0 0.1" mass="2"/>' for i in range(KNOBS))
    (folder / "rock.xml").write_text(
        f'<mujoco>{HEAD}<worldbody><body name="rock"><freejoint name="free"/>{knobs}</body></worldbody></mujoco>'
    )
    system = compile_paths(folder / "hand.xml", {"rock": folder / "rock.xml"})
    return system, mujoco.MjData(system.mj)


def course_of(system, data, rng, *, away):
    """The rock on its way past the fingers, all of them in motion."""
    mujoco.mj_resetData(system.mj, data)
    joints = {name: system.mj.joint(name) for name in ("robot/free", "rock/free")}
    data.qvel[:] = 0.5 * rng.normal(size=system.mj.nv)
    place, velocity = joints["rock/free"].qposadr[0], joints["rock/free"].dofadr[0]
    data.qpos[place : place + 3] = (0.0, 0.0, away)
    data.qvel[velocity : velocity + 3] = rng.normal(size=3) * 0.2 - np.array((0.0, 0.0, 2.0 * away))
    mujoco.mj_forward(system.mj, data)
    pairs = [
        ContactPair(system, f"{i}-{k}", f"robot/finger{i}", f"rock/knob{k}", 1.0)
        for i in range(FINGERS)
        for k in range(KNOBS)
    ]
    detector = Detector(Scene(system, data), pairs)
    return EventDrivenIntegrator(Motion(system.mj, data), [detector]), pairs


def touch_of_hand(system, data, seed):
    course, _ = course_of(system, data, np.random.default_rng(seed), away=1.0)
    for step in range(600):
        elapsed, contact_model = course.advance(0.002)
        if contact_model is not None:
            return step + elapsed / 0.002, data.qpos.copy()
    return None


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_the_first_touch_is_that_of_evaluating_all_pairs_in_every_step(hand, monkeypatch, seed):
    system, data = hand
    found = touch_of_hand(system, data, seed)
    monkeypatch.setattr(Clearances, "after_step", lambda self: np.flatnonzero(~self._skipped))
    every = touch_of_hand(system, data, seed)
    assert (found is None) == (every is None)
    if found is not None:
        assert found[0] == every[0]
        assert np.array_equal(found[1], every[1])


def test_distant_pairs_are_hardly_evaluated(hand, monkeypatch):
    """By energy alone, which says little of a finger of a gram, all 30 pairs would be evaluated in each of 500 steps."""
    system, data = hand
    course, pairs = course_of(system, data, np.random.default_rng(1), away=5.0)
    data.qvel[:] *= 0.1
    course.restart()
    assert speeds_per_root_energy(system.mj, data, pairs).max() > 50.0
    queries = []
    query = ContactPair.gap
    monkeypatch.setattr(ContactPair, "gap", lambda self, *args: queries.append(self) or query(self, *args))
    for _ in range(500):
        course.advance(0.002)
    assert len(queries) < 2 * len(pairs)


def test_a_slide_that_runs_away_renews_the_bounds(hand):
    """A finger that slides 20 m off the hand lengthens every lever: a rock out there is hit nevertheless."""
    system, data = hand
    course, _ = course_of(system, data, np.random.default_rng(0), away=1.0)
    data.qvel[:] = 0.0
    finger, rock = system.mj.joint("robot/finger1"), system.mj.joint("rock/free")
    data.qvel[finger.dofadr[0]] = 20.0
    data.qpos[rock.qposadr[0] : rock.qposadr[0] + 3] = (-0.15, 20.0, 0.2)
    mujoco.mj_forward(system.mj, data)
    course.restart()
    hit_s = 0.0
    contact_model = None
    while contact_model is None and hit_s < 2.0:
        elapsed, contact_model = course.advance(0.002)
        hit_s += elapsed
    # Masses of 1 g and 50 kg: the finger slides at constant speed over the base to 1e-4.
    knob_at = 20.0 - 0.05
    assert hit_s == pytest.approx(knob_at / 20.0, rel=1e-3)
