"""Published robots as their vendors ship them: a collision, its proof, figures, film, viewer, and a rerun."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image
from rerun.chunk import RrdReader

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.log.drawing import geoms_to_draw
from tests.robots.published import ROBOTS, write_scenario

pytestmark = pytest.mark.robots

FIGURES = {"motion", "base", "joints", "torques", "momenta", "energies", "conservation"}


@pytest.fixture
def viewed(monkeypatch) -> list[set[str]]:
    """What viewers would have shown, as entities of their recordings; there seems to be a display."""
    shown: list[set[str]] = []

    def call(command: list[str]) -> int:
        shown.append({chunk.entity_path for chunk in RrdReader(command[-1]).stream()})
        return 0

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(subprocess, "call", call)
    return shown


def ffsm(capfd: pytest.CaptureFixture[str], *arguments: object) -> str:
    """What a command says that ends well and has nothing to complain of."""
    capfd.readouterr()
    code = main([str(argument) for argument in arguments])
    out, err = capfd.readouterr()
    assert (code, err) == (0, ""), out + err
    return out


@pytest.mark.parametrize("name", ROBOTS)
def test_a_published_robot_collides_and_proves_it(name, tmp_path, capfd, viewed):
    there, out = tmp_path / "there", tmp_path / "out"
    there.mkdir()
    scenario = write_scenario(name, there)
    assert "conservative: nothing in the models breaks it" in ffsm(capfd, "check", scenario)

    assert f"{name}: completed; 1 s simulated" in ffsm(capfd, "run", scenario, "--out", out)
    run = ffsm_mj.load_run(out)
    assert run.impacts
    assert run.unhandled_contacts == ()
    assert all(check.passes for check in all_checks(run))
    for impact in run.impacts:
        assert impact.impulse_N_s > 0.1
        # What a rigid impact of this restitution loses: (1 - e^2) m u^2 / 2 with m = impulse / ((1 + e) u). To the rounding
        # of the kinetic energies that the change is the difference of, below 1 J each.
        lost = 0.5 * (1.0 - impact.restitution) * impact.impulse_N_s * impact.approach_speed_m_s
        assert impact.energy_change_J == pytest.approx(-lost, abs=1e-14)

    robot = json.loads(scenario.read_text())["robot"]
    vendor = [there / folder for folder in (*robot.get("asset_folders", ()), *robot.get("package_paths", ()))]
    used = {file: content for file, content in run.log.header.files.items() if file.startswith("mjcf/robot/")}
    ours = {Path(file).name for file, content in used.items() if not _is_shipped(file, content, vendor)}
    assert ours == ({robot["mjcf"]} - {"ur5_robot.urdf"})

    # As somebody else would have it: the folder alone.
    shutil.rmtree(there)
    assert f"checks pass over 1 s ({len(run.time)} samples)" in ffsm(capfd, "analyze", out)
    assert {path.stem for path in _figures(capfd, out, tmp_path / "figures")} >= FIGURES
    ffsm(capfd, "export", out, "--gif", "--out", tmp_path / "film.gif")
    assert _moves(tmp_path / "film.gif")
    ffsm(capfd, "view", out)

    ffsm(capfd, "run", out / "scenario.yaml", "--out", tmp_path / "again", "--no-rerun")
    again = ffsm_mj.load_run(tmp_path / "again")
    np.testing.assert_array_equal(again.log.rows[:], run.log.rows[:])
    assert again.log.header.files == run.log.header.files
    ffsm(capfd, "view", tmp_path / "again")  # of the log, which has no recording beside it
    assert viewed[0] == viewed[1]
    assert any(entity.startswith("/world/impacts/0/") for entity in viewed[0])
    shown = {entity.rpartition("/")[2] for entity in viewed[0] if entity.startswith(("/world/robot/", "/world/rock/"))}
    model = prepare(out).system.mj
    geoms = {model.geom(geom).name.rpartition("/")[2] for geom in geoms_to_draw(model)}
    assert geoms <= shown


def _figures(capfd: pytest.CaptureFixture[str], run: Path, folder: Path) -> list[Path]:
    ffsm(capfd, "analyze", run, "--plots", folder)
    return sorted(folder.glob("*.svg"))


def _moves(film: Path) -> bool:
    with Image.open(film) as pictures:
        first = np.asarray(pictures.convert("RGB"))
        pictures.seek(pictures.n_frames - 1)
        return pictures.n_frames > 10 and not np.array_equal(first, np.asarray(pictures.convert("RGB")))


@pytest.mark.parametrize("name", ROBOTS)
def test_explicit_inertials_change_nothing(name, tmp_path):
    """Every body of a vendor's robot gets what it weighs as numbers, and is the same bit by bit; one can weigh 3.3 kg."""
    path = write_scenario(name, tmp_path)
    own = prepare(path).system.mj
    bodies = [own.body(b).name.partition("/")[2] for b in range(own.nbody) if own.body(b).name.startswith("robot/")]
    again = prepare(path, {"model": {"robot": {body: {} for body in bodies}}}).system.mj
    for field in dir(own):
        if isinstance(value := getattr(own, field, None), np.ndarray):
            np.testing.assert_array_equal(getattr(again, field), value, err_msg=field)
    heavy = own.body(int(np.argmax(own.body_mass))).name.partition("/")[2]
    (change,) = prepare(path, {"model": {"robot": {heavy: {"mass_kg": 3.3}}}}).changes
    assert change.after == 3.3 != change.before


def _is_shipped(file: str, content: bytes, folders: list[Path]) -> bool:
    """Whether a file of this name and these bytes lies in the vendor's folders."""
    return any(path.read_bytes() == content for folder in folders for path in folder.rglob(Path(file).name))


def test_pinocchio_reads_the_same_robot_from_the_vendors_file(tmp_path, capfd):
    """UR5: energy and momenta of every sample, before and after the impact, by another engine from the URDF itself."""
    ffsm(capfd, "run", write_scenario("ur5", tmp_path), "--out", tmp_path / "out", "--no-rerun")
    run, robot = ffsm_mj.load_run(tmp_path / "out"), prepare(tmp_path / "out").system.robot
    model = pin.buildModelFromUrdf(str(tmp_path / "ur5_robot.urdf"), pin.JointModelFreeFlyer())
    data = model.createData()
    hinges = [joint.name.removeprefix("robot/") for joint in robot.joints[1:]]
    assert list(model.names[2:]) == hinges
    assert len(run.impacts) >= 1
    momenta = run.momentum("robot")
    for i, (qpos, qvel) in enumerate(zip(run.qpos, run.qvel, strict=True)):
        q, v = qpos[: model.nq].copy(), qvel[: model.nv].copy()
        q[3:7] = qpos[[4, 5, 6, 3]]  # the scalar of a quaternion is last there
        v[:3] = pin.Quaternion(q[3:7]).matrix().T @ qvel[:3]  # and the velocity of a free body in its own axes
        energy = pin.computeKineticEnergy(model, data, q, v)
        momentum = pin.computeCentroidalMomentum(model, data, q, v)
        about_origin = momentum.angular + np.cross(pin.centerOfMass(model, data, q), momentum.linear)
        # Some hundred products of size 1 or less, each rounded to 1e-16, and principal axes of the inertias to as much.
        assert energy == pytest.approx(run["energy.robot_J"][i], rel=1e-12, abs=1e-13)
        np.testing.assert_allclose(np.concatenate((momentum.linear, about_origin)), momenta[i], rtol=0, atol=1e-13)
