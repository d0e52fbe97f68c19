"""The law that plays recorded efforts: its own logs, closed forms, a published robot, and faults of files."""

from __future__ import annotations

from typing import Literal

import mujoco
import numpy as np
import pinocchio as pin
import pyarrow as pa
import pyarrow.parquet
import pytest

import ffsm_mj
from ffsm_controllers.playback.record import EffortRecord
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import FileName, StrictModel
from ffsm_mj.errors import InputError
from tests.laws import Law
from tests.model.test_pinocchio import oracle
from tests.scenes import ball, scene, two_balls

PERIOD_S, MASS_KG = 0.01, 2.0


def playing(file, **law):
    return [{"name": "play", "until": "end", "controller": {"kind": "playback", "file": str(file), **law}}]


def pushed(folder, rows, *, file="force.csv", **law):
    """A ball of 2 kg that a recorded force pushes along x for 1 s."""
    (folder / "force.csv").write_text("\n".join(["time_s,push_x_N", *(",".join(map(repr, row)) for row in rows)]) + "\n")
    keys = {"time_step_s": PERIOD_S, "control_period_s": PERIOD_S, "phases": playing(file, **law)}
    return scene(folder, ball(mass=MASS_KG, joints="xy"), {}, **keys)


def state(run):
    """Columns that follow from the motion."""
    groups = ("state.", "energy.", "momentum.", "balance.")
    return {key: run[key] for key in run.log.header.layout.index if key.startswith(groups)}


@pytest.mark.long
def test_a_log_is_played_bit_for_bit(tmp_path):
    """Through an impact inside a tick that is a capture at once, and a release at a tick."""
    keys = {"duration_s": 9.0, "time_step_s": 0.005, "control_period_s": 0.01}
    arm = {"kind": "osdre", "joints": ["joint_1", "joint_2", "joint_3"], "Q": [1.0, 1.0, 0.5, 0.5], "R": [0.1, 0.1, 0.1]}
    phases = [
        {"name": "approach", "until": "grasp", "arm": ["grasp"], "controller": arm | {"R": [1.0, 1.0, 1.0]}},
        {"name": "carry", "for_s": 0.5, "controller": arm},
        {"name": "let_go", "until": "end", "release": ["grasp"], "controller": arm},
    ]
    run = ffsm_mj.run("capture-planar", keys | {"phases": phases}, out=tmp_path / "run", rerun=False)
    law = {"kind": "playback", "file": str(tmp_path / "run"), "time": {"since": "run"}}
    playing = keys | {"phases": [phase | {"controller": law} for phase in phases]}
    played = ffsm_mj.run("capture-planar", playing, out=tmp_path / "played", rerun=False)
    again = ffsm_mj.run(tmp_path / "played")  # from the copy of the efforts in the run folder
    assert [len(run.impacts), len(run.log.records["grasp_impulses"]), len(run.log.records["releases"])] == [1, 1, 1]
    assert 1e-3 < run.impacts[0].time_s % 0.01 < 9e-3  # between two ticks, where tables of samples have no row
    for other in (played, again):
        assert all(np.array_equal(column, other[key]) for key, column in state(run).items())
        # At the tick of the release, the efforts after it stand for those before it too, for no time.
        differ = [run[key] != other[key] for key in run.log.header.layout.index if "_applied_" in key]
        assert np.count_nonzero(np.any(differ, axis=0)) <= 1
    assert all(check.passes for check in all_checks(played))
    assert (tmp_path / "played" / "recorded" / "run.csv").is_file()
    assert not any("note" in phase["reports"] for phase in played.summary()["controller"]["phases"])


def test_force_replaces_the_recorded_file_of_an_earlier_run(tmp_path):
    path = pushed(tmp_path, [(0.0, 1.0), (0.5, 2.0)])
    for _ in range(2):
        ffsm_mj.run(path, out=tmp_path / "run", force=True, rerun=False)
    ffsm_mj.run(
        path,
        {"phases": [{"name": "a", "until": "end", "controller": {"kind": "off"}}]},
        out=tmp_path / "run",
        force=True,
        rerun=False,
    )
    assert not (tmp_path / "run" / "recorded").exists()


def test_held_samples_give_piecewise_parabolas(tmp_path):
    forces = [3.0, -1.0, 2.0, 0.0, 4.0]
    run = ffsm_mj.run(pushed(tmp_path, [(0.1 + 0.15 * i, force) for i, force in enumerate(forces)]))
    position = velocity = 0.0
    for force in forces:  # each for 0.15 s, the last one too; then the motor is off
        position += velocity * 0.15 + 0.5 * force / MASS_KG * 0.15**2
        velocity += force / MASS_KG * 0.15
    position += velocity * 0.15
    # 100 steps of a sum of order 1: rounding below 1e-14.
    assert run["state.q_robot_x_m"][-1] == pytest.approx(position, abs=1e-13)
    assert run["state.v_robot_x_m_s"][-1] == pytest.approx(velocity, abs=1e-13)
    assert all(check.passes for check in all_checks(run))


def test_a_ramp_gives_a_cubic(tmp_path):
    """Ticks hold the mean of the ramp, so velocities are exact at ticks, and each tick adds jerk h^3/12 to the position."""
    slope = 5.0
    run = ffsm_mj.run(pushed(tmp_path, [(0.0, 0.0), (1.0, slope)], interpolation="linear"))
    t, jerk = run["state.time_s"], slope / MASS_KG
    assert run["state.v_robot_x_m_s"] == pytest.approx(jerk * t**2 / 2, abs=1e-13)
    assert run["state.q_robot_x_m"] == pytest.approx(jerk * (t**3 / 6 + PERIOD_S**2 * t / 12), abs=1e-13)


def test_the_impulse_of_straight_lines_between_ticks_is_exact(tmp_path):
    rng = np.random.default_rng(7)
    times, forces = np.sort(rng.uniform(0.05, 0.95, 37)), rng.normal(size=37)
    path = pushed(tmp_path, list(zip(times.tolist(), forces.tolist(), strict=True)), interpolation="linear")
    assert ffsm_mj.run(path)["state.v_robot_x_m_s"][-1] == pytest.approx(np.trapezoid(forces, times) / MASS_KG, abs=1e-13)
    ends = {"phases.play.controller.before": "hold", "phases.play.controller.after": "hold"}
    impulse = np.trapezoid([forces[0], *forces, forces[-1]], [0.0, *times, 1.0])
    assert ffsm_mj.run(path, ends)["state.v_robot_x_m_s"][-1] == pytest.approx(impulse / MASS_KG, abs=1e-13)


def test_the_impulse_of_held_samples_with_jitter_is_exact_in_the_mean(tmp_path):
    """Stamps of a recorder of 10 ms that is up to 2 ms early or late; the last sample lasts as long as the one before."""
    rng = np.random.default_rng(8)
    times, forces = 0.01 * np.arange(1, 90) + rng.uniform(-2e-3, 2e-3, 89), rng.normal(size=89)
    path = pushed(tmp_path, list(zip(times.tolist(), forces.tolist(), strict=True)), interpolation="mean")
    impulse = forces.dot(np.diff(times, append=2 * times[-1] - times[-2]))
    assert ffsm_mj.run(path)["state.v_robot_x_m_s"][-1] == pytest.approx(impulse / MASS_KG, abs=1e-13)
    ends = {"phases.play.controller.before": "hold", "phases.play.controller.after": "hold"}
    impulse = forces.dot(np.diff([0.0, *times[1:], 1.0]))
    assert ffsm_mj.run(path, ends)["state.v_robot_x_m_s"][-1] == pytest.approx(impulse / MASS_KG, abs=1e-13)


def test_the_mean_of_samples_at_ticks_is_the_sample():
    """At large times too, where the difference of two times is rounded to 1e-8 of a tick."""
    record = EffortRecord(1e5 + 0.001 * np.arange(9), np.arange(9.0)[:, None] / 7.0, "mean", end_s=2e5)
    for i in range(9):
        assert record.over(float(record.times_s[i]), 0.001) == pytest.approx([i / 7.0], rel=1e-7)
    assert record.over(float(record.times_s[8]), 0.001) == pytest.approx([8 / 7.0], rel=1e-15)


def test_samples_between_ticks_are_late_and_said_to_be(tmp_path):
    run = ffsm_mj.run(pushed(tmp_path, [(0.0, 1.0), (0.504, 2.0), (0.506, 3.0), (0.9, 4.0)]))
    report = run.summary()["controller"]["phases"][0]["reports"]
    assert (report["skipped_samples"], report["latest_sample_s"]) == (1, pytest.approx(0.004))
    assert "begin up to 0.004 s late, and 1 are never played: they lie between control ticks" in report["note"]


def test_units_scales_clocks_and_forms_of_files(tmp_path):
    """The same force, written in other ways."""
    forces = [3.0, -1.0, 2.0]
    wanted = ffsm_mj.run(pushed(tmp_path, [(0.2 * i, force) for i, force in enumerate(forces)]))["state.q_robot_x_m"]
    (tmp_path / "plain.txt").write_text(
        "# stamps and two forces\n" + "".join(f"{7000 + 200 * i} 9 {-1e3 * f}\n" for i, f in enumerate(forces))
    )
    pa.parquet.write_table(pa.table({"t_ms": [0, 200, 400], "push_x_mN": [3e3, -1e3, 2e3]}), tmp_path / "force.parquet")
    stamps = [1_700_000_000_000_000_077 + 200_000_000 * i for i in range(3)]
    (tmp_path / "epoch.csv").write_text(
        "stamp_ns,push_x_N\n" + "".join(f"{s},{f}\n" for s, f in zip(stamps, forces, strict=True))
    )
    pa.parquet.write_table(pa.table({"stamp_ns": stamps, "push_x_N": forces}), tmp_path / "epoch.parquet")
    (tmp_path / "untimed.csv").write_text('push_x;note\n3;a\n-1;"b; c"\n2;c\n')
    for law in (
        {
            "file": "plain.txt",
            "columns": {"push_x": {"column": 3, "unit": "mN", "scale": -1.0}},
            "time": {"column": 1, "unit": "ms", "zero": "first_sample"},
        },
        {"file": "force.parquet", "time": {"column": "t_ms"}},
        {"file": "epoch.csv", "time": {"column": "stamp_ns", "zero": "first_sample"}},  # in floats, stamps round to 256 ns
        {"file": "epoch.parquet", "time": {"column": "stamp_ns", "zero": "first_sample"}},
        {"file": "untimed.csv", "unit": "N", "time": {"step_s": 0.2}},
        {"file": "force.csv", "columns": {"robot/push_x": "push_x_N"}, "time": {"since": "run"}},
    ):
        run = ffsm_mj.run(tmp_path / "scene.yaml", {"phases": playing(**law)})
        assert run["state.q_robot_x_m"] == pytest.approx(wanted, abs=1e-14)
        assert "note" not in run.summary()["controller"]["phases"][0]["reports"]


def test_the_clock_begins_with_the_phase_or_the_run(tmp_path):
    path = pushed(tmp_path, [(0.0, 1.0), (0.2, 2.0), (0.4, 0.0)])
    for since, offset_s, impulse in (("phase", 0.0, 0.6), ("run", 0.0, 0.2), ("phase", 0.65, 0.05), ("phase", -0.3, 0.2)):
        law = {"kind": "playback", "file": "force.csv", "time": {"since": since, "offset_s": offset_s}}
        wait = {"name": "wait", "for_s": 0.3, "controller": {"kind": "off"}}
        phases = [wait, {"name": "play", "until": "end", "controller": law}]
        run = ffsm_mj.run(path, {"phases": phases})
        assert run["state.v_robot_x_m_s"][-1] == pytest.approx(impulse / MASS_KG, abs=1e-13), (since, offset_s)


def test_a_phase_ends_with_the_record(tmp_path):
    path = pushed(tmp_path, [(0.0, 1.0), (0.25, 2.0)], after="hold")
    law = {"kind": "playback", "file": "force.csv", "after": "hold"}
    rest = {"name": "rest", "until": "end", "controller": {"kind": "off"}}
    (tmp_path / "other.csv").write_text("time_s,push_y_N\n0,2\n0.3,0\n")
    parts = {"controllers": {"along": law, "across": law | {"file": "other.csv"}}}
    for laws, end_s in (({"controller": law}, 0.5), (parts, 0.6)):
        run = ffsm_mj.run(path, {"phases": [{"name": "play", "until": "finished", **laws}, rest]})
        assert [(phase.reason, phase.start_s) for phase in run.log.phases] == [
            ("start", 0.0),
            ("finished", pytest.approx(end_s)),
        ]
    with pytest.raises(InputError, match=r"phases.0.until: off never finishes; detumble, joint_path, .* do$"):
        prepare(path, {"phases": [rest | {"until": "finished"}]})
    timed = {"phases": [rest | {"until": "finished", "for_s": 1.0}]}
    with pytest.raises(InputError, match=r"is_finished do; 'until: null' leaves for_s as the end of the phase"):
        prepare(path, timed)
    prepare(path, timed | {"phases.0.until": None})


def test_several_parts_play_files_of_their_own(tmp_path):
    path = pushed(tmp_path, [(0.0, 1.0), (1.0, 0.0)])
    (tmp_path / "other.csv").write_text("time_s,push_y_N\n0,2\n0.5,0\n")
    parts = {"along": {"kind": "playback", "file": "force.csv"}, "across": {"kind": "playback", "file": "other.csv"}}
    run = ffsm_mj.run(
        path, {"phases": [{"name": "play", "until": "end", "controllers": parts}]}, out=tmp_path / "run", rerun=False
    )
    velocities = [run[f"state.v_robot_{axis}_m_s"][-1] for axis in "xy"]
    assert velocities == pytest.approx([1.0 / MASS_KG, 1.0 / MASS_KG], abs=1e-13)
    assert {file.name for file in (tmp_path / "run" / "recorded").iterdir()} == {"force.csv", "other.csv"}


def test_at_an_event_the_rest_of_the_tick_is_played(tmp_path):
    """A ramp through an elastic hit inside a tick: the mean over the tick acts until then, the mean over its rest after."""
    path = two_balls(tmp_path, gap=0.207, time_step_s=PERIOD_S, control_period_s=PERIOD_S)
    (tmp_path / "force.csv").write_text("time_s,push_x_N\n0,0\n1,4\n")
    columns = {"robot/push_x": "push_x_N"}
    run = ffsm_mj.run(path, {"phases": playing("force.csv", interpolation="linear", columns=columns)})
    (impact,) = run.impacts
    before_s = impact.time_s % PERIOD_S
    assert 1e-3 < before_s < PERIOD_S - 1e-3
    # 2 N s at the start, 2 N s of the record; until the hit its ramp of 4 N/s has risen by half of what is left of the tick.
    extra = 4.0 * before_s * (PERIOD_S - before_s) / 2.0
    assert run["momentum.total_P_x_N_s"][-1] == pytest.approx(4.0 + extra, abs=1e-13)


class Looked(Law):
    """A law of a script with a table of its own."""

    class Config(StrictModel):
        """A file."""

        kind: Literal["looked"]
        table: FileName

    def __init__(self, config, context):
        (self.force,) = context.recorded["table"].numbers("f")

    def control(self, observation, command):
        command.drive([0], self.force)


def test_laws_of_scripts_read_tables_too(tmp_path):
    path = pushed(tmp_path, [(0.0, 1.0)], after="hold")
    (tmp_path / "own.csv").write_text("f\n3.5\n")
    law = {"phases": [{"name": "play", "until": "end", "controller": {"kind": "looked", "table": "own.csv"}}]}
    run = ffsm_mj.run(path, law, controllers={"looked": Looked}, out=tmp_path / "run", rerun=False)
    (tmp_path / "own.csv").unlink()
    again = ffsm_mj.run(tmp_path / "run", controllers={"looked": Looked})
    assert run["state.v_robot_x_m_s"][-1] == again["state.v_robot_x_m_s"][-1] == pytest.approx(3.5 / MASS_KG, abs=1e-13)


LINES = EffortRecord(np.array([1.0, 2.0]), np.array([[2.0], [4.0]]), interpolation="linear", end_s=2.0)


@pytest.mark.parametrize(("time_s", "mean"), [(0.5, None), (0.9, 1.29), (1.0, 2.25), (1.25, 2.75), (2.0, None)])
def test_mean_over_a_tick(time_s, mean):
    """Over 0.25 s; the tick at 0.9 s has (2 + 0.15) 0.15 N s of the record, over its whole period."""
    found = LINES.over(time_s, 0.25)
    assert found is None if mean is None else found == pytest.approx([mean])


FINAL = {
    "base_x": -0.005986286853,
    "base_y": -0.005391465128,
    "base_yaw": -0.243768795680,
    "joint_1": -0.598572319584,
    "joint_2": 1.036475566442,
    "joint_3": 1.643124353959,
}
"""Final state under the published torques, which are not shipped: digits of an integration by DOP853 at 1e-13."""


def test_the_published_robot_keeps_its_centre_of_mass():
    """Model and digits agree: at rest before, the centre of mass never moves; the tip is where it was computed to be."""
    made = prepare("air-bearing").assemble()
    model, data = made.system.mj, made.data
    centre = data.subtree_com[0].copy()
    for name, value in FINAL.items():
        data.qpos[made.system.joint(name).qpos] = value
    mujoco.mj_forward(model, data)
    # The digits have 1e-12 each; levers are below 1.3 m.
    assert data.subtree_com[0] == pytest.approx(centre, abs=5e-12)
    assert data.site("robot/tip").xpos[:2] == pytest.approx([0.99987092835, 0.00052886230], abs=1e-11)


def test_the_published_robot_moves_as_pinocchio_says():
    """The shipped torques, held for 10 ms each, integrated by Pinocchio's forward dynamics and RK4 at 2.5 ms."""
    run = ffsm_mj.run("air-bearing")
    made = prepare("air-bearing").assemble()
    model, _ = oracle(made.system.mj)
    held, h = model.createData(), 0.0025
    torques = np.array([run[f"actuators.robot_motor_{i}_applied_N_m"] for i in (1, 2, 3)]).T
    q, v = made.data.qpos.copy(), np.zeros(6)
    for torque in torques[:-1]:
        tau = np.concatenate((np.zeros(3), torque))
        for _ in range(4):
            q, v = _rk4(lambda q, v, tau=tau: pin.aba(model, held, q, v, tau), q, v, h)
    found = [run[key][-1] for key in run.log.header.layout.index if key.startswith("state.q_")]
    # Rates reach 0.3 rad/s: (rate h)^5 / 120 over 499 steps of 10 ms is 1e-12.
    assert found == pytest.approx(q.tolist(), abs=1e-11)
    assert np.abs(q[3:] - [FINAL[f"joint_{i}"] for i in (1, 2, 3)]).max() < 1e-3
    assert all(check.passes for check in all_checks(run))


def _rk4(acceleration, q, v, h):
    k1 = acceleration(q, v)
    k2 = acceleration(q + h / 2 * v, v + h / 2 * k1)
    k3 = acceleration(q + h / 2 * v + h**2 / 4 * k1, v + h / 2 * k2)
    k4 = acceleration(q + h * v + h**2 / 2 * k2, v + h * k3)
    return q + h * v + h**2 / 6 * (k1 + k2 + k3), v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def test_the_shipped_torques_are_those_of_a_path_to_the_published_joints():
    """As the header of the file says."""
    waypoint = {"at_s": 4.99, "positions": [FINAL[f"joint_{i}"] for i in (1, 2, 3)]}
    move = {"kind": "joint_path", "bandwidth_rad_s": 2.0, "waypoints": [waypoint]}
    path = ffsm_mj.run("air-bearing", {"phases": [{"name": "move", "until": "end", "controller": move}]})
    played = ffsm_mj.run("air-bearing")
    for i in (1, 2, 3):
        key = f"actuators.robot_motor_{i}_applied_N_m"
        assert played[key] == pytest.approx(path[key], abs=6e-10)  # nine decimals


FAULTS = [
    (
        "time_s,push_x_N\n0,1\n0.1,nan\n0.2,inf\n",
        {},
        "file: {csv}:3: column 'push_x_N' is 'nan' (and 1 more); finite numbers are",
    ),
    ("time_s,push_x_N\n0,1\n0.1,\n", {}, "file: {csv}:3: column 'push_x_N' is empty; finite numbers are allowed"),
    (
        "time_s,push_x_N\n\n0,1\n# b\n0.2,2\n0.1,3\n",
        {},
        "time: {csv}:6: time 0.1 follows 0.2 in column 'time_s'; times must",
    ),
    ("time_s,push_x_N\n0,1\n0,2\n", {}, "time: {csv}:3: time 0 follows 0 in column 'time_s'; times must ascend"),
    ("time_s,push_x_N\n0,1\n1\n", {}, "file: {csv}:3: has 1 columns, and line 1 has 2"),
    ("time_s,a_N,a_N\n0,1,2\n", {}, "file: {csv}: has two columns 'a_N'"),
    ("", {}, "file: {csv}: is empty; a table with a row for each sample is needed"),
    ("time_s,push_x_N\n", {}, "file: {csv}:1: has a header and no rows; a row for each sample is needed"),
    ("time_s,push_x_N\n0,1\n", {}, "file: {csv} has a single sample, which has no duration; write 'after: hold'"),
    (
        "time_s,push_x_N\n0,1\n",
        {"interpolation": "linear"},
        "interpolation: {csv} has a single sample; straight lines need two",
    ),
    ("t,push_x_N\n0,1\n", {}, "time: {csv} has no column time_s; write 'column', or 'step_s' of samples without times"),
    ("t,push_x_N\n0,1\n1,1\n", {"time": {"column": "t"}}, "time: the unit of column 't' is not stated; write 'unit: s'"),
    (
        "time_s,f\n0,1\n1,1\n",
        {"columns": {"push_x": "f"}},
        "columns.push_x: the unit of column 'f' is not stated; write 'unit: N or N m'",
    ),
    (
        "time_s,f_N_m\n0,1\n1,1\n",
        {"columns": {"push_x": "f_N_m"}},
        "columns.push_x: column 'f_N_m' is in N m, and robot/push_x takes a force; allowed: N, mN, kN",
    ),
    (
        "time_s,f_N\n0,1\n1,1\n",
        {"columns": {"push_x": "f_N"}, "unit": "mN"},
        "columns.push_x: column 'f_N' is in N by its name, and 'unit' says mN",
    ),
    (
        "time_s,f_N\n0,1\n1,1\n",
        {"columns": {"push_x": "g_N"}},
        "columns.push_x: {csv}: unknown column 'g_N' (did you mean 'f_N'?); allowed: f_N, time_s",
    ),
    ("time_s,f_N\n0,1\n1,1\n", {"columns": {"push_x": 3}}, "columns.push_x: {csv} has no column 3; allowed: 1 to 2"),
    (
        "time_s,f_N\n0,1\n1,1\n",
        {"columns": {"push_z": "f_N"}},
        "columns.push_z: unknown actuator 'push_z' (did you mean 'robot/push_y'?); allowed: robot/push_x, robot/push_y",
    ),
    (
        "time_s,f_N\n0,1\n1,1\n",
        {"columns": {"push_x": "f_N", "robot/push_x": "f_N"}},
        "columns.robot/push_x: names the actuator robot/push_x a second time; each has one column",
    ),
    ("time_s,f_N\n0,1\n1,1\n", {}, "file: {csv} has no column of an actuator; write 'columns', the column of each actuator"),
    (
        "time_s,push_x_N\n0,1\n1,1\n",
        {"file": "forse.csv"},
        "file: no such file {folder}/forse.csv (did you mean '{csv}'?)",
    ),
    ("time_s,push_x_N\n0,1\n1,1\n", {"file": "."}, "file: {folder}: contains no run.mcap"),
    ("time_s,push_x_N\n0,1\n1,1\n", {"unit": "Nm"}, "unit: should be 'N', 'mN', 'kN', 'N m', 'mN m', 'kN m' or 'A m^2'"),
    ("PAR1", {}, "file: {csv}: cannot be read as Parquet (Arrow"),
    ("\udcff", {}, "file: {csv}: is neither text in UTF-8, nor Parquet, nor a log of ffsm-mj"),
]


@pytest.mark.parametrize(("content", "law", "message"), FAULTS)
def test_faults_name_file_line_key_and_what_is_allowed(content, law, message, tmp_path):
    path = pushed(tmp_path, [(0.0, 1.0)], **{"file": "force.csv", **law})
    (tmp_path / "force.csv").write_bytes(content.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError) as error:
        prepare(path)
    wanted = message.format(csv=tmp_path / "force.csv", folder=tmp_path)
    assert str(error.value).startswith(f"{path}:1:")
    assert f": phases.0.controller.{wanted}" in str(error.value)
