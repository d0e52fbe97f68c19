"""``ffsm fit`` on recordings that our own simulator made: known restitution and friction, noise, mirrors, wrong input."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.identification.free_motion import JumpSearch
from ffsm_mj.identification.recording import read_recordings
from ffsm_mj.identification.rule_fits import NEEDED, SLIDING, chosen, fit_recordings, fit_rule
from tests.identification.recordings import BOX, MU, E, cube_runs, cube_scene, puck_runs, puck_scene, written

POSES, RATES = "time_s,x_m,y_m,yaw_rad", "x_m_s,y_m_s,yaw_rad_s"
NOISE = np.array([0.0, 1e-4, 1e-4, 1e-3])
"""Standard deviations of time, positions in m and angle in rad: those of motion capture."""


@pytest.fixture(scope="module")
def puck(tmp_path_factory):
    """Scenario, compiled, and the rows of its throws."""
    path = puck_scene(tmp_path_factory.mktemp("puck"))
    return prepare(path), puck_runs(path, 6)


def fitted(prepared, path, names, tables, **options):
    (one,) = fit_recordings([written(path / "data.csv", names, tables)], prepared, **options).rules
    return one


def test_poses_without_noise_give_the_coefficients(puck, tmp_path):
    """Samples every 10 ms, impacts anywhere between them: instants, contact points and velocities are those of the run.

    Flights are integrated by RK4 with steps of a fifth of a radian, which leaves 1e-8 of the velocities.
    """
    prepared, runs = puck
    one = fitted(prepared, tmp_path, POSES, [run[:, :4] for run in runs])
    assert len(one.of.jumps) > 2 * NEEDED
    assert one.law.e.value == pytest.approx(E, abs=1e-7)
    assert one.law.mu.value == pytest.approx(MU, abs=1e-7)
    assert one.least.errors.max() < 1e-6
    assert one.r_squared["as recorded"] == pytest.approx(1.0, abs=1e-9)
    assert max(abs(point.gap_m) for point in one.of.points) < 1e-6


def test_velocities_of_rows_give_the_coefficients(puck, tmp_path):
    prepared, runs = puck
    one = fitted(prepared, tmp_path, f"{POSES},{RATES}", runs)
    assert (one.law.e.value, one.law.mu.value) == pytest.approx((E, MU), abs=1e-8)


def test_the_edge_of_a_box_is_solved_as_in_a_run(tmp_path):
    """Both ends of an edge touch at once: a run takes the law for several contacts there, and so does the fit."""
    path = puck_scene(tmp_path, BOX)
    one = fitted(prepare(path), tmp_path, f"{POSES},{RATES}", puck_runs(path, 3))
    assert one.of.as_several
    assert (one.law.e.value, one.law.mu.value) == pytest.approx((E, MU), abs=1e-7)


@pytest.mark.long
def test_tosses_of_a_cube_in_space(tmp_path):
    """Corners on a slab under gravity: poses with noise give the coefficients within the intervals, to one part in 50."""
    path = cube_scene(tmp_path)
    random = np.random.default_rng(2)
    tables = [run[:, :8] + random.normal(size=(len(run), 8)) * [0, *3 * [1e-4], *4 * [3e-4]] for run in cube_runs(path, 12)]
    one = fitted(prepare(path), tmp_path, "time_s,cube_x_m,cube_y_m,cube_z_m,cube_qw,cube_qx,cube_qy,cube_qz", tables)
    assert one.of.axes == ("x", "y", "z")
    assert one.law.e.value == pytest.approx(E, rel=0.02)
    assert one.law.mu.value == pytest.approx(MU, rel=0.02)
    assert one.r_squared["as recorded"] > 0.99
    assert max(one.r_squared, key=lambda frame: one.r_squared[frame]) == "as recorded"


def covered(seeds, puck, folder):
    """In how many samples of noise the intervals of e and of mu cover the truth."""
    prepared, runs = puck
    hits = np.zeros(2)
    for seed in seeds:
        random = np.random.default_rng(seed)
        tables = [run[:, :4] + NOISE * random.normal(size=(len(run), 4)) for run in runs]
        law = fitted(prepared, folder, POSES, tables).law
        hits += [law.e.low <= E <= law.e.high, law.mu.low <= MU <= law.mu.high]
    return hits.tolist()


def test_a_metre_that_is_short_is_seen_in_the_fall(tmp_path):
    """Positions 2 % short, with noise of 0.1 mm: the cube falls by that less than the scenario says.

    The curvature of n samples over T has the standard deviation s sqrt(720 / n) / T^2: of two flights 0.001 of g.
    """
    random = np.random.default_rng(0)
    prepared, runs = prepare(cube_scene(tmp_path, duration_s=0.2)), cube_runs(tmp_path / "scene.yaml", 2)
    tables = [run[:, :8] * [1, 0.98, 0.98, 0.98, 1, 1, 1, 1] for run in runs]
    for table in tables:
        table[:, 1:4] += 1e-4 * random.normal(size=(len(table), 3))
    names = "time_s,cube_x_m,cube_y_m,cube_z_m,cube_qw,cube_qx,cube_qy,cube_qz"
    recordings = read_recordings([written(tmp_path / "data.csv", names, tables)], prepared.system, tables[0][0, 1:])
    assert JumpSearch(prepared.system.mj, recordings).jumps().fall == pytest.approx(0.98, abs=4e-3)


def test_intervals_cover_the_truth_in_a_tenth_of_the_samples(puck, tmp_path):
    """Of ten 95 % intervals at least eight cover the truth: with a coverage of 0.95 with probability 0.988."""
    assert min(covered(range(10), puck, tmp_path)) >= 8


@pytest.mark.long
def test_intervals_cover_the_truth(puck, tmp_path):
    """Of a hundred 95 % intervals at least 89 cover the truth: with a coverage of 0.95 with probability 0.996."""
    assert min(covered(range(100), puck, tmp_path)) >= 89


@pytest.mark.parametrize(
    ("signs", "said"),
    [
        ([1, -1, 1, 1, -1, 1, 1], "with (x|rotation) reversed"),
        ([1, 1, 1, -1, 1, 1, -1], "with (x|rotation) reversed"),
        ([1, 1, 1, 1, 1, -1, 1], "with y reversed in the velocities"),
        ([1, 1, 1, 1, 1, 1, -1], "with rotation reversed in the velocities"),
    ],
)
def test_a_mirrored_frame_is_refused_by_name(signs, said, puck, tmp_path):
    """A frame of the other handedness, or velocities alone: the walls are symmetric, so that mirrored bodies touch them too.

    Reversed x and reversed rotation are one mirror here, as the image of a motion in a mirror is a motion.
    """
    prepared, runs = puck
    with pytest.raises(InputError, match=f"frame is mirrored.*{said}"):
        fitted(prepared, tmp_path, f"{POSES},{RATES}", [run * signs for run in runs])


def test_a_tangent_reversed_in_the_velocities_is_refused(tmp_path):
    """Velocities along a floor have the other sign than positions: neither normal velocities nor energies show it."""
    path = cube_scene(tmp_path)
    runs = cube_runs(path, 5)
    signs = np.ones(14)
    signs[8] = -1.0
    poses = "time_s,cube_x_m,cube_y_m,cube_z_m,cube_qw,cube_qx,cube_qy,cube_qz"
    rates = "cube_vx_m_s,cube_vy_m_s,cube_vz_m_s,cube_wx_rad_s,cube_wy_rad_s,cube_wz_rad_s"
    with pytest.raises(InputError, match="moments of impulses with x reversed"):
        fitted(prepare(path), tmp_path, f"{poses},{rates}", [run * signs for run in runs])


def test_a_recording_in_other_units_is_the_same(puck, tmp_path):
    """Names with units, as in our logs or short, in text or Parquet: the numbers are those in SI."""
    prepared, runs = puck
    one = fitted(prepared, tmp_path, f"{POSES},{RATES}", runs)
    runs = [run.copy() for run in runs]
    for run in runs:  # a tracker says nothing of whole turns
        run[:, 3] = np.angle(np.exp(1j * run[:, 3]))
    every = np.concatenate([np.column_stack([np.full(len(run), k), run]) for k, run in enumerate(runs)])
    names = ["toss", "time_ms", "q_x_mm", "robot_y_cm", "state.q_robot_yaw_rad", "v_x_mm_s", "y_cm_s", "robot_yaw_deg_s"]
    factors = [1, 1e3, 1e3, 1e2, 1, 1e3, 1e2, 180.0 / math.pi]
    columns = dict(zip(names, (every * factors).T, strict=True))
    pyarrow.parquet.write_table(pa.table(columns), tmp_path / "data.parquet")
    (other,) = fit_recordings([tmp_path / "data.parquet"], prepared, run_column="toss").rules
    assert other.of.impacts.before == pytest.approx(one.of.impacts.before, abs=1e-9)


def test_impacts_that_stick_say_nothing_of_mu(puck, tmp_path):
    """Those of the same throws that stick, with a few that slide: e is fitted, mu is said to be unknown."""
    path = puck_scene(tmp_path, contacts={"rules": [{"between": ["puck", "frame"], "restitution": E, "mu": 0.6}]})
    every = fitted(prepare(path), tmp_path, f"{POSES},{RATES}", puck_runs(path, 6))
    few = ~every.slides
    few[np.flatnonzero(every.slides)[: SLIDING - 1]] = True
    one = fit_rule(chosen(every.of, few), "blend", {})
    assert one.sliding == SLIDING - 1
    assert not one.is_mu_known
    assert one.law.e.value == pytest.approx(E, abs=1e-7)
    assert every.is_mu_known
    assert puck[0].scenario.impact.law == "blend"


HEAD = "time_s,x_m,y_m,yaw_rad"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,x_m,y_m\n0,0,0\n", "data.csv: columns of robot are missing: yaw_rad"),
        ("x_m,y_m,yaw_rad\n0,0,0\n", "data.csv: has no column of times; allowed: state.time_s, time_s, time_ms"),
        ("time_s,x_in,y_m,yaw_rad\n0,0,0,0\n", "column 'x_in': its unit 'in' is unknown; allowed: x_m, x_cm, x_mm, x_um"),
        ("time_s,x,y_m,yaw_rad\n0,0,0,0\n", "column 'x': its unit is not stated; allowed: x_m"),
        ("time_s,disc_x_m,disc_y_m\n0,0,0\n", "column 'disc_x_m': unknown body 'disc'; allowed: robot"),
        (f"{HEAD},q_x_m\n0,0,0,0,0\n", "columns 'x_m' and 'q_x_m' are the same coordinate"),
        (f"{HEAD}\n0,0,0,0\n0.1,0,nan,0\n", "data.csv:3: column 'y_m' is 'nan'; finite numbers are allowed"),
        (f"{HEAD}\n0,0,0,0\n0.2,0,0,0\n0.1,0,0,0\n", "data.csv:4: column 'time_s': time 0.1 follows 0.2; times must ascend"),
        (f"{HEAD}\n0,0,0,0\n0.1,2e9,0,0\n", "data.csv:3: column 'x_m' is 2e9; at most 1e+06 in SI units is allowed"),
        ("time_s,v_x_m_s\n0,1\n", "has no column of a pose, such as 'x_m'"),
        (f"{HEAD}\n0,0,0,0\n", f"data.csv: too few impacts, {NEEDED} of a rule are needed; found none"),
        (f"{HEAD},x_m_s\n0,0,0,0,0\n", "columns of robot are missing: y_m_s, yaw_rad_s"),
    ],
)
def test_wrong_input_is_one_line(text, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    puck_scene(tmp_path)
    (tmp_path / "data.csv").write_text(text)
    assert main(["fit", "data.csv", "--scenario", "scene.yaml"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_files_and_lines_for_the_scenario(puck, tmp_path, monkeypatch, capsys):
    """The lines that are printed, put into the scenario, are its contact rule with the fitted numbers."""
    monkeypatch.chdir(tmp_path)
    path = puck_scene(tmp_path, contacts={"rules": [{"between": ["puck", "frame"], "restitution": 1.0, "name": "frame"}]})
    written(tmp_path / "data.csv", POSES, [run[:, :4] for run in puck[1]])
    assert main(["fit", "data.csv", "--scenario", str(path)]) == 0
    text = capsys.readouterr().out
    assert sorted(file.name for file in (tmp_path / "logs" / "scene-fit").iterdir()) == [
        f"fit.{form}" for form in ("csv", "json", "parquet", "png", "svg")
    ]
    assert f"- {{between: [puck, frame], name: frame, restitution: {E}, mu: {MU}}}" in text
    (tmp_path / "with.yaml").write_text("extends: scene.yaml\nname: with\n" + text[text.index("contacts:\n") :])
    (rule,) = prepare("with.yaml").scenario.contacts.rules
    assert (rule.name, rule.restitution, rule.mu) == ("frame", E, MU)
