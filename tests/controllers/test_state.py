"""A control law that is saved and restored goes on bit for bit, and every field of its state is needed for that."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.controller_protocol import StateError, with_state
from tests.controllers.detumbling import JETS, POSE, RATES, spacecraft
from tests.controllers.restored import Case, OpenLoop, declared, outcome, through_bytes, with_entry
from tests.controllers.task_laws import LAWS, SPATIAL, W, planar, spatial
from tests.controllers.test_gripper import SLIDES
from tests.controllers.test_moving_targets import MOVE
from tests.controllers.test_script_laws import documented
from tests.controllers.test_track import ARM as SEVEN
from tests.controllers.test_track import following
from tests.controllers.test_track import scene as tracking
from tests.laws import Law
from tests.scenes import ball, scene

WHEELS = ["wheel_0", "wheel_1", "wheel_2"]
SINGULAR = {"singular_mass_kg": 3.0}
TURNS = {"attitude": {"kp_1_s2": W**2, "kd_1_s": 2.0 * W}}
DETUMBLE = {"kind": "detumble", "wheels": WHEELS, "rate_1_s": 1.0}
SPINNING = {"joints": {"base": POSE}, "rates": {"base": RATES, "wheel_0": 0.65}}
FULL = {"kind": "reaction_wheel", "max_torque_N_m": 0.5, "max_speed_rad_s": 0.6}


def arm(law, **changes):
    return Case("baseline", planar(law, 0.02, 1.0, **changes))


def arm_in_space(law, **changes):
    return Case("spatial", spatial(law, 0.02, 1.0, **changes))


def craft(folder, law, *, jets="couples", **options):
    keys = {"time_step_s": 0.02, "control_period_s": 0.02, "initial": {"joints": {"base": POSE}, "rates": {"base": RATES}}}
    keys |= {"phases": [{"name": "all", "until": "end", **law}], **options.pop("keys", {})}
    return Case(scene(folder, spacecraft(jets=jets), {}, **keys), **options)


def hand(folder):
    law = {"kind": "gripper", "joints": ["left", "right"], "action": "close", "bandwidth_Hz": 1.0}
    keys = {"time_step_s": 0.01, "control_period_s": 0.01, "phases": [{"name": "all", "until": "end", "controller": law}]}
    return Case(scene(folder, SLIDES, {}, **keys))


def played(folder):
    """Samples that are late, and one that is never played, all before the law is saved."""
    rows = [(0.0, 1.0), (0.003, 2.0), (0.006, 3.0), *((0.01 * k, 0.5 * k) for k in range(2, 40))]
    (folder / "push.csv").write_text("\n".join(["time_s,push_x_N", *(f"{t!r},{u!r}" for t, u in rows)]) + "\n")
    law = {"kind": "playback", "file": str(folder / "push.csv")}
    keys = {"time_step_s": 0.01, "control_period_s": 0.01, "phases": [{"name": "all", "until": "end", "controller": law}]}
    return Case(scene(folder, ball(joints="xy"), {}, **keys), size=lambda _: 0.0)


def grasping(folder):
    """The spacecraft with a ball in its grasp: the load of the latch is largest at first."""
    grasp = {"robot_site": "tip", "object_site": "rock/centre", "when": {"within": {"position_m": 1e-3}}}
    keys = {"time_step_s": 0.02, "control_period_s": 0.02, "grasps": {"grasp": grasp | {"load_limit": {"force_N": 2.0}}}}
    keys |= {"phases": [{"name": "all", "until": "end", "arm": ["grasp"], "controller": DETUMBLE}]}
    return Case(scene(folder, spacecraft(), {"rock": ball("rock", mass=8.0)}, **keys), grasp="grasp")


def phase(law, **ending):
    after = {"name": "after", "until": "end", "controller": {"kind": "off"}}
    return {"phases": [{"name": "all", "controller": law, **ending}, after]}


HOLD = {"kind": "hold", "bandwidth_rad_s": 1.0}
OSDRE = {"kind": "osdre", "Q": [1.0, 1.0, 0.5, 0.5], "R": [1.0, 1.0, 1.0]}
BASE = {"thrusters": JETS, "translation": {"kp": 50.0, "kd": 37.5}, "rotation": {"kp": 200.0, "kd": 150.0}}
CASES = {
    "pd": lambda _: arm({"kind": "pd", "kp": 1.0, "kd": 2.0}),
    "hold": lambda _: arm(HOLD),
    "gripper": hand,
    "playback": played,
    "joint_path": lambda _: arm(
        {"kind": "joint_path", "bandwidth_rad_s": 1.0, "waypoints": [{"at_s": 0.6, "positions": [0.1, 0.2, 0.3]}]}
    ),
    "base_pd": lambda folder: craft(folder, {"controller": {"kind": "base_pd", **BASE}}),
    "base_pd, on a path": lambda folder: craft(
        folder,
        {
            "controller": {
                "kind": "base_pd",
                **BASE,
                "translation": BASE["translation"] | {"waypoints": [{"at_s": 0.6, "position_m": [1.0, 2.5, -1.0]}]},
            }
        },
    ),
    "free_flying": lambda folder: craft(
        folder, {"controller": {"kind": "free_flying", **BASE, "wheels": WHEELS, "arm": {"kp": 3.0, "kd": 2.0}}}
    ),
    **{
        f"transfer, {duration_s} s": lambda folder, duration_s=duration_s: craft(
            folder,
            {
                "controller": {
                    "kind": "transfer",
                    "thrusters": JETS,
                    "position_m": [2.0, 1.0, -1.0],  # where it is: POSE in LVLH axes
                    "duration_s": duration_s,
                }
            },
            keys={"environment": {"orbit": {"altitude_km": 400.0}}, "initial": {"joints": {"base": POSE}}},
            size=lambda tick: 1e-3 if tick > 12 else 0.0,
        )
        for duration_s in (0.2, 0.245, 9.0)
    },
    "detumble": lambda folder: craft(folder, {"controller": DETUMBLE | {"tolerance_N_m_s": 50.0}}),
    "detumble, arm moves": lambda folder: craft(
        folder, {"controller": DETUMBLE | {"arm": {"positions": [0.3], "over_s": 0.4}, "tolerance_N_m_s": 50.0}}
    ),
    "detumble, wheels are full": lambda folder: craft(
        folder,
        {"controller": DETUMBLE | {"thrusters": JETS, "tolerance_N_m_s": 0.4, "unload_to": 0.01}},
        keys={"actuators": dict.fromkeys(WHEELS, FULL), "initial": SPINNING},
        size=lambda tick: 0.0 if tick < 6 else 0.35,
    ),
    "detumble, nothing along an axis": lambda folder: craft(folder, {"controller": DETUMBLE | {"wheels": WHEELS[:1]}}),
    "detumble, in a grasp": grasping,
    **{f"{kind}, planar": lambda _, kind=kind, law=law: arm({"kind": kind, **law}) for kind, law in LAWS.items()},
    "rns, base held": lambda _: arm({"kind": "rns", **LAWS["rns"], "base": {"kp_1_s2": 1.0, "kd_1_s": 1.0}}),
    **{
        f"{kind}, in space": lambda _, kind=kind, law=law: arm_in_space({"kind": kind, **law})
        for kind, law in SPATIAL.items()
    },
    "task_ct, near a singularity": lambda _: arm({"kind": "task_ct", **LAWS["task_ct"], **SINGULAR}),
    "impedance, at its bound": lambda _: arm({"kind": "impedance", "position": {"stiffness_N_m": 1.0, "max_force_N": 1e-3}}),
    "track": lambda _: Case(
        "capture",
        tracking(
            following(
                max_torque_N_m=0.05,
                base={"wheels": ["wheel_x", "wheel_y", "wheel_z"], "rotation": {"kp_N_m_rad": 1.0, "kd_N_m_s_rad": 1.0}},
                singular_mass_kg=3.0,
            )
        ),
    ),
    "track, out of reach": lambda _: Case("capture", tracking(following(offset_m=[-3.0, 0.0, 0.0], max_joint_rate=0.08))),
    "osdre": lambda _: arm(OSDRE),
    "osdre, three outputs": lambda _: arm_in_space({"kind": "osdre", "joints": SEVEN, "Q": [1.0] * 6, "R": [1.0] * 7}),
    "osdre, moving target": lambda _: arm(OSDRE, task=MOVE),
    "parts": lambda folder: craft(
        folder,
        {
            "controllers": {
                "arm": {"kind": "hold", "joints": ["shoulder"], "bandwidth_rad_s": 1.0},
                "base": {"kind": "base_pd", **BASE},
                "wheels": {"kind": "off"},
            }
        },
    ),
    "settled": lambda _: Case(
        "baseline",
        planar(
            HOLD, 0.02, 1.0, **phase(HOLD, until="settled", settled={"error_m": 100.0, "speed_m_s": 100.0, "for_s": 0.4})
        ),
        trigger=True,
    ),
    "stop_when": lambda _: Case(
        "baseline", planar(HOLD, 0.02, 1.0, **phase(HOLD, stop_when="tip_error < 100 m for 0.4 s")), trigger=True
    ),
}


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    return {name: outcome(case(tmp_path_factory.mktemp("case"))) for name, case in CASES.items()}


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("name", CASES)
def test_goes_on_bit_for_bit(name, outcomes):
    assert outcomes[name].anew == outcomes[name].uninterrupted
    assert outcomes[name].back == outcomes[name].uninterrupted


@pytest.mark.parametrize("name", CASES)
def test_a_state_fits_a_law_that_has_not_been_started(name, outcomes):
    """And the state of such a law one that has been: as it is taken back to before its phase."""
    assert outcomes[name].idle == outcomes[name].uninterrupted[0]
    once, again = outcomes[name].begun
    assert again == once


def test_every_field_of_every_state_is_needed(outcomes):
    noticed = set().union(*(each.noticed for each in outcomes.values()))
    assert declared("ffsm_controllers") - declared("ffsm_controllers.estimators") - noticed == set()


def test_a_part_that_remembers_without_the_pair_is_refused_by_name(tmp_path):
    """A law of a user counts its calls, and no state would have the count."""

    class Counts(Law):
        def __init__(self, config, context):
            self._calls = 0

        def control(self, observation, command):
            self._calls += 1

    parts = {"arm": HOLD | {"joints": ["shoulder"]}, "mine": {"kind": "counts"}}
    case = craft(tmp_path, {"controllers": parts}, controllers={"counts": Counts})
    loop = OpenLoop(case)
    law = loop.law()
    law.start(loop.at(0))
    law.get_state()
    loop.follow(law, range(1))
    with pytest.raises(StateError, match=r"part 'mine' \(counts\) remembers '_calls'"):
        law.get_state()


def test_a_law_around_another_one_does_not_hide_what_that_remembers():
    loop = OpenLoop(arm(HOLD))
    outer = type("Outer", (), {})()
    outer.inner = loop.law()
    part = with_state(outer, "the control law 'outer'")
    part.get_state()
    outer.inner.start(loop.at(0))
    with pytest.raises(StateError, match="the control law 'outer' remembers 'inner'"):
        part.get_state()


def test_shapes_of_several_arrays_are_told_apart():
    """That of one array is a tuple that is gone before the next one is looked at, and may leave it its place in memory."""
    law = type("Law", (), {})()
    law.gains, law.last = np.zeros((2, 1)), np.zeros((3, 1))
    part = with_state(law, "the control law 'law'")
    part.get_state()
    law.last = law.last.reshape(1, 3)
    with pytest.raises(StateError, match="remembers 'last'"):
        part.get_state()


def test_the_documented_law_is_restored(tmp_path):
    """Its annotations are no texts; its integral is that of all ticks."""
    case = craft(tmp_path, {"controller": {"kind": "integral"}}, controllers={"integral": documented(3)["Integral"]})
    found = outcome(case)
    assert found.anew == found.back == found.uninterrupted
    assert found.noticed == {"Integral.reference", "Integral.integral", "Integral.last_s"}
    law = OpenLoop(case).law()
    with pytest.raises(StateError, match=r"Integral.integral: needs an array of shape"):
        law.set_state(with_entry(through_bytes(law), ("integral",), np.zeros(9)))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("stiffness",), np.eye(2), r"Hold.stiffness: needs an array of shape \(3, 3\), but has shape \(2, 2\)"),
        (("errors",), {"values": [0.0]}, "JointErrors: needs values, largest, but has values"),
        (("errors",), 1.0, "JointErrors: needs values, largest, but is float"),
    ],
)
def test_a_state_that_does_not_fit_is_an_error(path, value, words):
    loop = OpenLoop(arm(HOLD))
    law = loop.law()
    state = with_entry(through_bytes(law), path, value)
    with pytest.raises(StateError, match=words):
        law.set_state(state)
