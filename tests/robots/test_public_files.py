"""Mass matrix and bias of public files in a scene, beside MuJoCo's own compile of the file alone.

Each file of the packages either has the masses that MuJoCo gives it or is refused by a message that names it.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import InputError
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import ModelFiles, read_model
from tests.robots.vendors import vendor_path

pytestmark = pytest.mark.robots

STATES = 10
WITHOUT_MASS = ("damping", "frictionloss", "stiffness", "equalities", "servos", "gravcomp", "sensors")
"""What may be removed where a file is refused for it: it changes neither mass matrix nor bias, as tendons do."""
FLOATS = "so it cannot float"
PACKAGES = (
    ("robosuite", "robosuite/models/assets"),
    ("dm_control", "dm_control"),
    ("example-robot-data", "cmeel.prefix/share/example-robot-data"),
)


def robot_files(folder: Path) -> list[Path]:
    """Files of models: with the root element of MJCF or URDF."""
    found = [*folder.rglob("*.xml"), *folder.rglob("*.urdf")]
    return sorted(path for path in found if any(root in path.read_bytes() for root in (b"<mujoco", b"<robot")))


def alone(path: Path) -> Any:
    """The file as MuJoCo itself compiles it, its root floating where it does in a scene; None where MuJoCo does not."""
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        if path.suffix == ".urdf":  # its meshes are found by packages, which MuJoCo knows nothing of
            spec.compiler.fusestatic = False
            for geom in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]:
                spec.delete(geom)
            for mesh in list(spec.meshes):
                spec.delete(mesh)
            spec.worldbody.first_body().add_freejoint()
        return spec.compile()
    except (ValueError, mujoco.FatalError):
        return None


def in_a_scene(path: Path, folder: Path) -> Any:
    """The model of a scene with the file: floating, or mounted on a floating body where its root does not move.

    Raises:
        InputError: It is refused for something else than what can be removed without a change of masses.
    """
    files = read_model(path)
    try:
        return compiled(files)
    except InputError as refusal:
        if FLOATS not in str(refusal):
            raise
    root = mujoco.MjSpec.from_file(str(path)).worldbody.first_body().name
    bus = folder / "bus.xml"
    bus.write_text(f"""<mujoco model="bus"><compiler angle="radian" autolimits="true"/>
      <asset><model name="file" file="{os.path.relpath(path, folder)}"/></asset>
      <worldbody><body name="bus"><freejoint name="float"/><geom type="box" size="0.4 0.4 0.3" mass="200"/>
        <frame><attach model="file" body="{root}" prefix="on_"/></frame></body></worldbody></mujoco>""")
    return compiled(read_model(bus, [path.parent]))


def compiled(files: ModelFiles) -> Any:
    for without in ((), WITHOUT_MASS):
        try:
            return compile_system(replace(files, strip=without), {}, time_step_s=1e-3, conservative=False).mj
        except InputError as error:
            refusal = error
    raise refusal


def mass_and_bias(model: Any, data: Any, qpos: Any, qvel: Any) -> tuple[Any, Any]:
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    return mass_matrix(model, data), data.qfrc_bias


def difference(own: Any, ours: Any) -> float:
    """Greatest difference of mass matrix and bias at random states, relative to their scale; a mount is at rest."""
    assert ours.nv - own.nv in (0, 6), f"{ours.nv} degrees of freedom for {own.nv}"
    own.opt.gravity[:] = ours.opt.gravity[:] = 0.0  # each scenario states its own
    rng, worst, data = np.random.default_rng(0), 0.0, (mujoco.MjData(own), mujoco.MjData(ours))
    on_qpos, on_qvel = ours.nq - own.nq, ours.nv - own.nv
    for _ in range(STATES):
        qpos, qvel = rng.normal(size=own.nq), rng.normal(size=own.nv)
        mujoco.mj_normalizeQuat(own, qpos)
        mount = (np.eye(7)[3], np.zeros(6)) if on_qvel else (np.zeros(0), np.zeros(0))
        one = mass_and_bias(own, data[0], qpos, qvel)
        mass, bias = mass_and_bias(ours, data[1], *map(np.concatenate, zip(mount, (qpos, qvel), strict=True)))
        assert len(mount[0]) == on_qpos
        for a, b in zip(one, (mass[on_qvel:, on_qvel:], bias[on_qvel:]), strict=True):
            worst = max(worst, float(np.max(np.abs(a - b), initial=0.0) / max(1.0, float(np.max(np.abs(a), initial=0.0)))))
    return worst


@pytest.mark.parametrize(("package", "folder"), PACKAGES)
def test_public_files_have_their_masses_or_are_refused_by_name(package, folder, tmp_path):
    """The sums run over a tree that begins one body later: rounding only."""
    wrong, compared = [], 0
    for path in robot_files(vendor_path(package, folder)):
        try:
            ours = in_a_scene(path, tmp_path)
        except InputError as refusal:
            if path.name not in str(refusal) and "file" not in str(refusal):
                wrong.append(f"{path}: not named: {refusal}")
            continue
        if (own := alone(path)) is None:
            continue
        try:
            compared, apart = compared + 1, difference(own, ours)
        except AssertionError as error:
            wrong.append(f"{path}: {error}")
            continue
        if apart > 1e-9:
            wrong.append(f"{path}: {apart:.1e}")
    assert wrong == []
    assert compared >= 10
