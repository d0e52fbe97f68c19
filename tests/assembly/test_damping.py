"""What ``check`` says of damping gains at a control period, in closed form and against runs."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.notes import unstable_damping
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import Damping, mass_matrix, reduced_model
from tests.model.test_own_robot import FILES
from tests.scenes import ARM, HEAD, ball, scene

PERIOD = 0.01
BASE, WHEEL = 2.0, 0.5
REDUCED = BASE * WHEEL / (BASE + WHEEL)
"""Both turn about the axis through both mass centres: what the joint moves is the inertia of one against the other."""
SPINNER = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="3" diaginertia="4 4 {BASE}"/>
  <body name="wheel"><joint name="spin" axis="0 0 1"/><inertial pos="0 0 0.3" mass="1" diaginertia="0.4 0.4 {WHEEL}"/></body>
  </body></worldbody><actuator><motor name="spin" joint="spin" gear="7"/></actuator></mujoco>"""


def spinner(folder: Path, law: dict, robot: str = SPINNER, **more) -> Path:
    data = {
        "duration_s": 2.0,
        "control_period_s": PERIOD,
        "phases": [{"name": "hold", "until": "end", "controller": law}],
    }
    apart = {"joints": {"rock/free": [9, 0, 0, 1, 0, 0, 0]}}
    return scene(folder, robot, {"rock": ball("rock")}, **{"initial": apart} | data | more)


def notes(path: Path, *overrides: str) -> list[str]:
    return [line for line in prepare(path, overrides).describe() if line.startswith("note: phase")]


def told(note: str) -> tuple[float, float]:
    """Eigenvalue and largest stable gain."""
    eigenvalue, most = re.findall(r"eigenvalue ([\d.e+-]+) .* up to ([\d.e+-]+)", note)[0]
    return float(eigenvalue), float(most)


LAWS = [
    (lambda kd: {"kind": "pd", "kp": 0.0, "kd": kd}, "kd"),
    (lambda kd: {"kind": "free_flying", "arm": {"kp": 0.0, "kd": kd}}, "arm.kd"),
]


@pytest.mark.parametrize(("law", "key"), LAWS)
def test_the_eigenvalue_of_one_joint_in_closed_form(tmp_path, law, key):
    kd = 160.0
    (note,) = notes(spinner(tmp_path, law(kd)))
    kind = law(kd)["kind"]
    assert note.startswith(f"note: phase 'hold' ({kind}): {key} is unstable at the control period of 0.01 s: ")
    assert f"mostly of joint 'robot/spin'; {key} = 160 there is stable up to" in note
    eigenvalue, most = told(note)
    assert eigenvalue == pytest.approx(PERIOD * kd / REDUCED, rel=5e-3)  # three digits are printed
    largest = 2.0 * REDUCED / PERIOD
    # Three digits, rounded down: less than one part in a hundred below, and never above but for rounding.
    assert 0.99 * largest <= most <= largest * (1.0 + 1e-12)


@pytest.mark.parametrize(("share", "stable"), [(0.975, True), (1.025, False)])
def test_a_run_goes_the_way_that_check_says(tmp_path, share, stable):
    """Each tick takes the rate to (1 - eigenvalue) times what it was, be there a spring or not."""
    kd, kp, ticks = share * 2.0 * REDUCED / PERIOD, 5.0, 200
    path = spinner(
        tmp_path,
        {"kind": "pd", "kp": kp, "kd": kd},
        initial={"joints": {"rock/free": [9, 0, 0, 1, 0, 0, 0]}, "rates": {"spin": 0.01}},
    )
    assert bool(notes(path)) is not stable
    run = ffsm_mj.run(path)
    rate = np.abs(run["state.v_robot_spin_rad_s"])
    # (1 - x)^200 with x = 2 share is 3.5e-5 or 1.7e4; the terms of kp in the root near -1, each dt^2 kp / 2 I = 6e-4, nearly
    # cancel; one of them alone is 13 % in the end. The slow root's part: kp / kd = 0.06 / s times a way of 0.01 s, 6e-4.
    growth = rate[-1] / rate[0]
    assert growth < 1e-2 if stable else growth > 0.5 * (2 * share - 1) ** ticks


def test_many_joints_are_held_against_the_reduced_model(tmp_path):
    law = {"kind": "pd", "kp": 1.0, "kd": [3.0, 40.0]}
    path = spinner(tmp_path, law, ARM)
    (note,) = notes(path)
    assembly = prepare(path).assemble()
    M = mass_matrix(assembly.system.mj, assembly.data)[:8, :8]
    none = np.zeros((0, 8))
    M_c = reduced_model(M, np.zeros(8), none, np.zeros(0), np.array([6, 7]), np.arange(6)).M_c
    expected = np.max(np.linalg.eigvals(PERIOD * np.linalg.solve(M_c, np.diag(law["kd"]))).real)
    eigenvalue, most = told(note)
    assert eigenvalue == pytest.approx(expected, rel=5e-3)
    assert "'robot/elbow'; kd = 40 there" in note
    assert note.endswith(", with the others in proportion")
    below = [most / 40.0 * kd for kd in law["kd"]]
    assert notes(path, f"phases.hold.controller.kd={below}") == []
    assert len(notes(path, f"phases.hold.controller.kd={[1.01 * kd for kd in below]}")) == 1


def test_null_space_damping_counts_where_the_output_does_not_feel_it():
    """The printed largest damping is stable, a hundredth more is not; an arm without a null space takes any."""
    key = "phases.approach.controller.null_space_damping"
    (note,) = notes("spatial", f"{key}=1000")
    assert note.startswith("note: phase 'approach' (osdre): null_space_damping is unstable")
    eigenvalue, most = told(note)
    assert most == pytest.approx(2000.0 / eigenvalue, rel=1.5e-2)
    assert notes("spatial", f"{key}={most}") == []
    assert len(notes("spatial", f"{key}={1.011 * most}")) == 1


def test_the_page_is_stable_and_says_up_to_what(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    assert notes(tmp_path / "crab.yaml") == notes(tmp_path / "otto.yaml") == []
    (note,) = notes(tmp_path / "crab.yaml", "phases.hold.controller.kd=100")
    page = (Path(__file__).parents[2] / "docs" / "own-robot.md").read_text()
    assert f"is stable up to {told(note)[1]:g};" in page
    # With 12 the rate does not change sign: the eigenvalue is below 1.
    assert told(note)[1] / 2.0 > 12.0


@pytest.mark.parametrize("law", [{"kind": "off"}, {"kind": "free_flying"}])
def test_who_does_not_damp_is_left_alone(tmp_path, law):
    assert notes(spinner(tmp_path, law)) == []


def test_a_law_that_cannot_tell_is_a_note_and_no_more(tmp_path):
    assembly = prepare(spinner(tmp_path, {"kind": "pd", "kp": 0.0, "kd": 1.0})).assemble()
    law = assembly.controller.phases[0].controller
    law.damping_at = lambda _: Damping("gain", np.array([6]), np.ones(1), np.ones((2, 2)))
    (note,) = unstable_damping(assembly)
    assert note.startswith("phase 'hold' (pd): its damping cannot be computed (ValueError")
    law.damping_at = lambda _: Damping("gain", np.array([6]), np.ones(1), np.full((1, 1), math.nan))
    (note,) = unstable_damping(assembly)
    assert "its damping cannot be computed (LinAlgError" in note
