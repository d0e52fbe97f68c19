"""A model file as MuJoCo's editable specification, completed: names for all, and what URDF has no words for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco

from ffsm_mj.errors import InputError


def load_spec(path: Path) -> Any:
    """Read an MJCF or URDF file; every body, joint, geom, site and actuator has a name afterwards.

    Raises:
        InputError: No such file, or MuJoCo cannot parse it.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such model file")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InputError(mujoco_line(path, error)) from error
    if path.suffix.lower() == ".urdf":
        _complete_urdf(spec)
    _name_all(spec)
    return spec


def _complete_urdf(spec: Any) -> None:
    """Give a URDF what it has no words for: a floating root, a motor on each joint, a site on each link.

    The free joint is named ``base``, a motor ``<joint>_motor``, a site like its link.
    """
    spec.compiler.fusestatic = False  # a fixed tool frame stays a body, and so does the root
    root = spec.worldbody.first_body()
    if root is not None and not root.joints:
        root.add_freejoint(name="base")
    for body in spec.bodies[1:]:
        body.add_site(name=body.name)
    for joint in spec.joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            motor = spec.add_actuator(name=f"{joint.name}_motor", target=joint.name)
            motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
            motor.set_to_motor()


def _name_all(spec: Any) -> None:
    """Name what has no name after what it belongs to, because logs, scenarios and errors speak of names."""
    taken = {element.name for kind in ("bodies", "joints", "geoms", "sites", "actuators") for element in getattr(spec, kind)}

    def name(element: Any, wanted: str) -> None:
        if not element.name:
            element.name = next(n for n in (wanted, *(f"{wanted}_{i}" for i in range(2, 10_000))) if n not in taken)
            taken.add(element.name)

    for body in spec.bodies[1:]:  # the first is the world
        name(body, "body")
        for joint in body.joints:
            name(joint, f"{body.name}_joint")
    for geom in spec.geoms:
        name(geom, f"{geom.parent.name}_geom")
    for site in spec.sites:
        name(site, f"{site.parent.name}_site")
    for actuator in spec.actuators:
        name(actuator, f"{actuator.target or 'actuator'}_motor")


def mujoco_line(path: Path, error: ValueError) -> str:
    """MuJoCo's own message on one line, with the file in front."""
    return f"{path}: {' '.join(str(error).split())}"
