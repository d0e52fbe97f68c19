"""Pairs that bear together, of which the motion does not tell who bears what: shares are of least norm, everywhere."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.grasp.test_pressing import MASS, along, pressed, rail
from tests.contact_models.impact.test_fixed import slab
from tests.replays import proved
from tests.scenes import HEAD, ball, scene

BALL = '<geom name="{0}" type="sphere" size="0.1" pos="{1} 0 0" mass="0"/>'
BOX = '<geom name="{0}" type="box" size="0.05 0.04 0.1" pos="{1} 0 0" mass="0"/>'
POINTS = {BALL: [(0.0, 0.0)], BOX: [(x, y) for x in (-0.05, 0.05) for y in (-0.04, 0.04)]}
"""Where a foot touches, from its middle."""
JOINTS = {"x": "slide' axis='1 0 0", "z": "slide' axis='0 0 1", "pitch": "hinge' axis='0 1 0", "roll": "hinge' axis='1 0 0"}


def standing(folder, feet, joints, *, head=HEAD, weight="", **scenario):
    """A table of 2 kg that touches a slab at z = 0 with its feet, ready to be pressed on by a motor at ``z``.

    Args:
        folder: For its files.
        feet: MJCF of each and where it is along x, m, by name.
        joints: Of the table, some of ``JOINTS``.
        head: MJCF of the options.
        weight: MJCF of what is on it.
        scenario: What else is in the scenario.
    """
    robot = f"""<mujoco>{head}<worldbody><body name="table"><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
      {"".join(f"<joint name='{name}' type='{JOINTS[name]}'/>" for name in joints)}
      {"".join(mjcf.format(name, at) for name, (mjcf, at) in feet.items())}{weight}</body></worldbody>
      <actuator><motor name="press" joint="z"/></actuator></mujoco>"""
    pairs = [{"name": name, "between": [name, "slab/slab"], "restitution": 0.0} for name in feet]
    scenario["initial"] = {"joints": {"robot/z": 0.1}, **scenario.get("initial", {})}
    return scene(
        folder,
        robot,
        {"slab": slab("slab")},
        fixed={"slab": {"position_m": [0, 0, -0.5]}},
        contacts={"rules": pairs},
        **{"duration_s": 0.1, "time_step_s": 5e-3, "control_period_s": 5e-3, **scenario},
    )


@pytest.mark.parametrize(
    ("feet", "joints"),
    [
        ({"left": (BALL, -0.5), "right": (BALL, 0.5)}, "z"),
        ({"left": (BOX, -0.5), "right": (BOX, 0.5)}, "z pitch roll"),
        ({"left": (BALL, -0.5), "middle": (BALL, 0.0), "right": (BALL, 0.5)}, "x z pitch"),
        ({"left": (BALL, -0.5), "off": (BALL, 0.2), "right": (BOX, 0.5)}, "x z pitch"),
    ],
)
def test_feet_share_by_least_norm(tmp_path, feet, joints):
    """Of all forces at the points with the sum and the moments of the press, the shortest: in rows and integrals alike."""
    # A spring of 1e-6 N/m that would be at rest 2e6 m below: 2 N, but for 5e-8 of it.
    push = {"kind": "pd", "joints": ["z"], "kp": 1e-6, "kd": 0.0, "target": [-2e6]}
    phases = [{"name": "press", "until": "end", "controller": push}]
    run = proved(ffsm_mj.run(standing(tmp_path, feet, joints.split(), phases=phases)))
    places = {name: np.array(POINTS[kind]) + np.array((at, 0.0)) for name, (kind, at) in feet.items()}
    x, y = np.vstack(list(places.values())).T
    balances = np.array([np.ones_like(x), x, y])[: 1 + ("pitch" in joints) + ("roll" in joints)]
    points = np.linalg.pinv(balances)[:, 0] * -run["actuators.robot_press_applied_N"][-1]
    assert points.min() > 0.0
    for name, of_foot in zip(feet, np.split(points, np.cumsum([len(each) for each in places.values()])[:-1]), strict=True):
        share = of_foot.sum()
        np.testing.assert_allclose(run[f"contact.{name}_force_N"], share, rtol=1e-9)
        assert run[f"contact.{name}_impulse_N_s"][-1] == pytest.approx(share * run.time[-1], rel=1e-9)
        assert set(run[f"contact.{name}_mode"]) == {2.0}  # each presses


def walking(folder, start_m, speed_m_s, step_s, duration_s=0.5):
    """A table on three feet under 10 m/s^2, on which 1 kg walks."""
    feet = {"left": (BALL, -0.5), "middle": (BALL, 0.0), "right": (BALL, 0.5)}
    weight = """<body name="weight"><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
      <joint name="walk" type="slide" axis="1 0 0"/></body>"""
    return standing(
        folder,
        feet,
        ("x", "z", "pitch"),
        head='<option gravity="0 0 -10"/>',
        weight=weight,
        conservative=False,
        initial={"joints": {"robot/z": 0.1, "walk": start_m}, "rates": {"walk": speed_m_s}},
        duration_s=duration_s,
        time_step_s=step_s,
        control_period_s=step_s,
    )


def test_a_weight_walks_off_a_table(tmp_path):
    """Shares follow the moment as it grows; a foot without a share stays in touch, and opens where the table tips.

    Under 10 m/s^2 the table of 2 kg has feet at -a, 0 and a = 0.5 m, and 1 kg walks on it at 1 m/s from x = 0.8 m. The load
    of W = 30 N is at s a = x / 3. Of least squares are W / 3 (1 - 1.5 s), W / 3, W / 3 (1 + 1.5 s): none pulls until
    s = 2 / 3, at 0.2 s. From there the other two bear W (1 - s) and W s, until s = 1, at 0.7 s.
    """
    run = proved(ffsm_mj.run(walking(tmp_path, 0.8, 1.0, 0.01, duration_s=0.75)))
    # A gap'' counts as opening past 1e-9 of its terms, some 10 m/s^2, and grows by some 10 m/s^2 in a second.
    endings = {record.pair: record.time_s for record in run.records["contact_endings"]}
    assert endings == pytest.approx({"left": 0.7, "middle": 0.7}, abs=1e-8)
    rows = run.time < 0.7 - 1e-6
    s = (0.8 + run.time[rows]) / 1.5
    three = s < 2.0 / 3.0
    shares = {
        "left": np.where(three, 10.0 * (1.0 - 1.5 * s), 0.0),
        "middle": np.where(three, 10.0, 30.0 * (1.0 - s)),
        "right": np.where(three, 10.0 * (1.0 + 1.5 * s), 30.0 * s),
    }
    for name, share in shares.items():
        np.testing.assert_allclose(run[f"contact.{name}_force_N"][rows], share, atol=1e-8)
        # Linear before and after 0.2 s, which is a row: trapezia are exact.
        integral = np.sum(0.5 * (share[1:] + share[:-1]) * np.diff(run.time[rows]))
        assert run[f"contact.{name}_impulse_N_s"][rows][-1] == pytest.approx(integral, abs=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("step_s", [0.02, 0.005])
@pytest.mark.parametrize(("start_m", "speed_m_s"), [(0.8037, 1.0), (1.2013, -1.0)])
def test_a_share_that_begins_or_ends_inside_a_step_has_its_impulse(tmp_path, start_m, speed_m_s, step_s):
    """Wherever the kink is in a step: impulses are the integrals, of run and replay alike.

    A quadrature over the kink misses up to 10 N/s h^2 / 8, 5e-4 N s at 20 ms. The kink is known to 1e-6 of a step, to the
    square of which the impulse is off: 4e-15 N s.
    """
    run = proved(ffsm_mj.run(walking(tmp_path, start_m, speed_m_s, step_s)))
    kink = (1.0 - start_m) / speed_m_s
    # Of least squares where the middle is between the others, of two where the left one has nothing.
    shares = {"left": lambda s: 10.0 * (1.0 - 1.5 * s), "right": lambda s: 10.0 * (1.0 + 1.5 * s), "middle": lambda _: 10.0}
    of_two = {"left": lambda _: 0.0, "right": lambda s: 30.0 * s, "middle": lambda s: 30.0 * (1.0 - s)}
    first, second = (shares, of_two) if speed_m_s > 0.0 else (of_two, shares)
    for name in shares:
        pieces = [(first[name], 0.0, kink), (second[name], kink, 0.5)]
        expected = sum(
            (end - begin) * share((start_m + speed_m_s * 0.5 * (begin + end)) / 1.5) for share, begin, end in pieces
        )
        assert run[f"contact.{name}_impulse_N_s"][-1] == pytest.approx(expected, abs=1e-9)


@pytest.mark.usefixtures("example_contact_models")
def test_a_finger_and_what_is_held_share_a_wall(tmp_path):
    """Both lean on it, and the rail does not tell who bears what: half each, and the link bears that of the held."""
    finger = '<geom name="finger" type="sphere" size="0.1" pos="0.2 0.5 0" mass="0"/>'
    pairs = [
        {"name": name, "between": [geom, "wall/wall"], "restitution": 0.0}
        for name, geom in (("late", "target/target"), ("own", "finger"))
    ]
    robot, wall = ball("ball", mass=MASS["robot"], joints="x", extra=finger), {"wall": slab("wall", "0.1 2 0.5")}
    path = rail(tmp_path / "scene", wall, pairs, fixed={"wall": {"position_m": [0.47, 0, 0]}}, robot=robot)
    run = proved(ffsm_mj.run(path))
    rows = pressed(run)
    motor = run["actuators.robot_push_x_applied_N"][rows]
    for what in ("late", "own", "grasp"):
        np.testing.assert_allclose(along(run, what, rows), [[0.5 * force, 0.0, 0.0] for force in motor], atol=1e-13)
