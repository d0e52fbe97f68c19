"""Initial states with equality constraints: closed by what the scenario leaves out, corrected, or refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from tests.mechanisms.models import SLIDER_CRANK, WELDED, four_bar, geared, mechanism, parallelogram, turned, two_loops


def started(folder, mjcf, joints, rates, **scenario):
    """Coordinates and rates by joint at the start, and the notes on them."""
    assembly = prepare(mechanism(folder, mjcf, joints, rates, **scenario)).assemble()
    data, joints = assembly.data, assembly.system.joints
    places = {name.partition("/")[2]: (data.qpos[each.qpos], data.qvel[each.dofs]) for name, each in joints.items()}
    return places, assembly.start_notes


def refused(folder, mjcf, joints, rates, **scenario):
    with pytest.raises(InputError) as error:
        started(folder, mjcf, joints, rates, **scenario)
    (line,) = error.value.lines
    return line


def test_joints_without_a_value_close_the_loop(tmp_path):
    """M3: coupler and rocker follow from the crank, and their rates from its rate; the base stays."""
    joints, notes = started(
        tmp_path, four_bar(), {"robot/base": [1, 2, 3, *turned(0.4)], "crank": math.pi / 3}, {"crank": 2.0}
    )
    assert joints["coupler"][0] == pytest.approx(-0.697034315309, abs=1e-12)
    assert joints["rocker"][0] == pytest.approx(1.555752341392, abs=1e-12)
    np.testing.assert_array_equal(joints["base"][0], [1, 2, 3, *turned(0.4)])
    # Rates by the loop: crank 2, end of the coupler on the rocker.
    a, b, c = math.pi / 3, joints["coupler"][0][0], joints["rocker"][0][0]
    J = [[-0.35 * math.sin(a + b), 0.25 * math.sin(c)], [0.35 * math.cos(a + b), -0.25 * math.cos(c)]]
    right = [0.3 * math.sin(a), -0.3 * math.cos(a)]
    turn, rocker = np.linalg.solve(J, right)
    assert joints["coupler"][1] == pytest.approx(turn - 2.0, abs=1e-12)
    assert joints["rocker"][1] == pytest.approx(rocker, abs=1e-12)
    assert np.abs(joints["base"][1]).max() < 1e-15
    assert notes[0].startswith(
        "joints without an initial value move to close the equality constraints: robot/coupler -0.697"
    )


def test_a_loop_far_from_closed_closes(tmp_path):
    """The slider starts at the centre of the crank, .45 m from the end of the rod; and a crank that closes two loops."""
    joints, _ = started(tmp_path, SLIDER_CRANK, {"crank": 0.5}, {"crank": 3.0})
    rod = -0.5 - math.asin(0.5 * math.sin(0.5))
    assert joints["rod"][0] == pytest.approx(rod, abs=1e-12)
    assert joints["slider"][0] == pytest.approx(0.15 * math.cos(0.5) + 0.3 * math.cos(0.5 + rod), abs=1e-12)
    _, notes = started(tmp_path, two_loops(), {"crank": math.pi / 3}, {"crank": 2.0})
    assert all(f"robot/{name} " in notes[0] for name in ("c1", "c2", "r1", "r2"))


@pytest.mark.parametrize("away", [0.0, 1e3])
def test_coordinates_close_at_any_distance(tmp_path, away):
    joints, _ = started(tmp_path, parallelogram(), {"robot/base": [away, -away, 0, 1, 0, 0, 0], "bar0": 0.8}, {"bar0": 1.5})
    for name in ("bar1", "bar2"):
        assert joints[name][0] == pytest.approx(0.8, abs=1e-11 * (1 + away))
        assert joints[name][1] == pytest.approx(1.5, abs=1e-11 * (1 + away))


def test_a_follower_leads_where_only_it_has_a_value(tmp_path):
    joints, _ = started(tmp_path, geared(), {"B": -1.5}, {"B": 3.0})
    assert joints["A"][0] == pytest.approx(0.5, abs=1e-14)
    assert joints["A"][1] == pytest.approx(-1.0, abs=1e-14)


def test_rates_that_contradict_each_other_are_stopped_by_an_impulse_of_the_rows(tmp_path):
    """M9: momentum is kept, and the loss is said."""
    joints, notes = started(tmp_path, geared(), {}, {"robot/base": [0.1, 0, 0, 0, 0, 0.1], "A": 1.0, "B": -2.0})
    np.testing.assert_allclose(joints["base"][1][[0, 1, 5]], [0.1, -0.000119426752, 0.107563694268], rtol=0, atol=1e-12)
    assert joints["A"][1] == pytest.approx(0.784633757962, abs=1e-12)
    assert joints["B"][1] == pytest.approx(-2.353901273885, abs=1e-12)
    assert "takes 0.000692675 J" in notes[0]


@pytest.mark.parametrize(("error", "told"), [(1e-13, 0), (1e-7, 0), (1e-4, 1), (4e-3, 1)])
def test_values_that_are_nearly_right_are_corrected(tmp_path, error, told):
    joints, notes = started(tmp_path, geared(), {"A": 0.5, "B": -1.5 + error}, {})
    assert joints["B"][0] == pytest.approx(-3.0 * joints["A"][0], abs=2e-12)
    # In the metric of M the wheels share the error by 1/9 and less.
    assert abs(joints["A"][0] - 0.5) <= error
    assert len(notes) == told
    for note in notes:
        a, b = map(float, re.search(r"corrected to robot/A ([\d.]+), robot/B (-[\d.]+)", note).groups())
        assert (round(a, 2), round(b, 2)) == (0.5, -1.5)


def test_values_that_contradict_each_other_are_refused_with_the_nearest_ones(tmp_path):
    line = refused(tmp_path, geared(), {"A": 0.5, "B": 0.2}, {})
    assert "initial.joints.B" in line
    assert f"{tmp_path / 'robot.xml'}:1: equality joint of 'B' and 'A' by 1.7 m or rad" in line
    a, b = (float(line.partition(f"robot/{name} ")[2].split(",")[0]) for name in "AB")
    assert b == pytest.approx(-3.0 * a, abs=1e-8)


def test_a_loop_that_cannot_close_is_refused(tmp_path):
    """A coupler that is too long, stretched and not."""
    for crank in (0.0, 1.0):
        line = refused(tmp_path, four_bar().replace('pos=".35 0 0"', 'pos=".9 0 0"'), {"crank": crank}, {})
        assert "equality 'pin'" in line
        assert "cannot be closed" in line


def test_a_polynomial_without_a_solution_is_refused(tmp_path):
    """B = 1 + A^2, locked at 0.5."""
    text = geared().replace('polycoef="0 -3 0 0 0"/>', 'polycoef="1 0 1 0 0"/><joint joint1="B" polycoef=".5 0 0 0 0"/>')
    assert "cannot be closed" in refused(tmp_path, text, {"A": 0.3}, {})
    line = refused(tmp_path, geared().replace('"0 -3 0 0 0"', '"1 0 1 0 0"'), {"B": 0.3}, {})
    assert "equality joint of 'B' and 'A' by 0.7 m or rad; nearest values that fit: robot/B 1" in line


def test_a_weld_that_is_turned_by_half_a_turn_is_not_closed(tmp_path):
    """The sine of its angle vanishes there."""
    assert "turned by more than a quarter turn" in refused(tmp_path, WELDED, {"turn": [0, 1, 0, 0]}, {})
    joints, _ = started(tmp_path, WELDED, {}, {"robot/base": [0, 0, 0, 0.1, 0.2, 0.3]})
    assert np.abs(joints["turn"][1]).max() < 1e-14


@pytest.mark.parametrize(
    ("equality", "expected"),
    [
        ('<connect body1="A" body2="world" anchor="0 0 0"/>', "joins a body to the world"),
        ('<weld body1="A"/>', "joins a body to the world"),
        ('<tendon tendon1="wrapped"/>', "couples a tendon with wrapping geoms"),
    ],
)
def test_what_cannot_be_a_row_is_refused(tmp_path, equality, expected):
    """With file, line and what is allowed."""
    text = geared(geom='<site name="sa" pos=".1 0 0"/>').replace("<equality>", f"\n<equality>\n{equality}")
    wrapped = '<spatial name="wrapped"><site site="sa"/><geom geom="post"/><site site="sb"/></spatial>'
    post = '<site name="sb" pos="0 1 0"/><geom name="post" type="sphere" size=".05" mass="0"/>'
    text = text.replace("<tendon>", f"<tendon>{wrapped}").replace('<body name="A"', f'{post}<body name="A"')
    line = refused(tmp_path, text, {}, {})
    assert f"{tmp_path / 'robot.xml'}:3: equality" in line
    assert expected in line


def test_check_lists_rows_rank_and_mobility(tmp_path, capfd):
    """M7: six rows of rank three of a base with four hinges, beside a free rock; near the change point there is a note."""
    path = mechanism(tmp_path, parallelogram(), {"bar0": 0.8}, {})
    assert main(["check", str(path)]) == 0
    told = capfd.readouterr().out
    assert "2 equality constraints: 6 rows of rank 3, mobility 13" in told
    assert "nearly singular" not in told
    path = mechanism(tmp_path, parallelogram(), {"bar0": 1e-5}, {})
    assert main(["check", str(path)]) == 0
    assert "the equality constraints are nearly singular at the initial state" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("polycoef", "expected"),
    [
        ("0 2 0 0 0", "nearest values that fit: robot/A 0.5, robot/B 1"),
        ("3 2 0 0 0", "nearest values that fit: robot/A -1, robot/B 1"),
        ("4 2 0 0 0", "nearest values that fit, none of which are within the ranges of all joints: robot/A -"),
    ],
)
def test_the_nearest_values_are_within_the_ranges_of_the_joints(tmp_path, polycoef, expected):
    """B = a0 + 2 A, both within 1 rad: the nearest values of all are beyond."""
    robot = geared('range="-1 1"', gear="2").replace('"0 2 0 0 0"', f'"{polycoef}"')
    robot = robot.replace('<joint name="A"', '<joint name="A" range="-1 1"')
    assert expected in refused(tmp_path, robot, {"A": 0.9, "B": 0.3}, {})
