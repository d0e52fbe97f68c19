"""The URDFs of ``example-robot-data`` as they are, meshes aside.

``uv run --group dev --group robots python -m tests.robots.urdfs``

The same throw as in :mod:`tests.robots.menagerie`: each mesh becomes a sphere of 20 mm, arms and hands stand on a bus of
500 kg, all others float on their own root. Nothing is stripped: couplings (``mimic``), limits of efforts, dry friction,
damping and ranges of the joints are modelled.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.robots.menagerie import on_a_bus, print_table
from tests.robots.vendors import vendor_path

_ON_A_BUS = (
    *("allegro_hand", "asr_twodof", "double_pendulum", "finger_edu", "kinova", "panda", "so_arm", "ur", "xarm", "z1"),
    "talos_data/talos_left_arm",
)
"""Arms and hands, by the beginning of their name: their makers fix them to the ground."""
_SPHERE_M = 0.02


@dataclass(frozen=True)
class Stated:
    """What a URDF states of its joints.

    Attributes:
        joints: Joints that move.
        mimics: Joints that follow another one.
        frictions: Dry friction by joint, where it is not zero, N or N m.
        efforts: Largest effort by joint, where it is not zero, N or N m.
    """

    joints: tuple[str, ...]
    mimics: tuple[str, ...]
    frictions: dict[str, float]
    efforts: dict[str, float]


def robots() -> dict[str, Path]:
    """Files with joints that move and with shapes, by folder and name; none if the package is not installed."""
    try:
        folder = vendor_path("example-robot-data", "cmeel.prefix/share/example-robot-data/robots")
    except pytest.fail.Exception:
        return {}
    found = {f"{path.relative_to(folder).parts[0]}/{path.stem}": path for path in sorted(folder.rglob("*.urdf"))}
    return {name: path for name, path in found.items() if stated(urdf := path.read_bytes()).joints and b"<geometry" in urdf}


def stated(urdf: bytes) -> Stated:
    """Joints, couplings, friction and efforts of a URDF."""
    moving = [each for each in ElementTree.fromstring(urdf).findall("joint") if each.get("type") not in ("fixed", None)]
    by_name = {str(each.get("name")): each for each in moving}
    return Stated(
        tuple(by_name),
        tuple(name for name, each in by_name.items() if each.find("mimic") is not None),
        _numbers(by_name, "dynamics", "friction"),
        _numbers(by_name, "limit", "effort"),
    )


def _numbers(joints: dict[str, ElementTree.Element], element: str, attribute: str) -> dict[str, float]:
    given = {name: each.find(element) for name, each in joints.items()}
    values = {name: float(each.get(attribute, 0.0)) for name, each in given.items() if each is not None}
    return {name: value for name, value in values.items() if value}


def write_urdf(robot: str, folder: Path) -> Path:
    """Write a robot with spheres for meshes to a folder, on a bus if it is an arm; returns its main file."""
    main = folder / "robot" / "robot.urdf"
    main.parent.mkdir()
    main.write_bytes(with_spheres(robots()[robot].read_bytes()))
    return on_a_bus(main) if robot.startswith(_ON_A_BUS) else main


def with_spheres(urdf: bytes) -> bytes:
    """A URDF with spheres for meshes and without textures; what is seen is solid where nothing else is."""
    root = ElementTree.fromstring(urdf)
    if root.find("link/collision") is None:
        for seen in root.iterfind("link/visual"):
            seen.tag = "collision"
    for geometry in root.iter("geometry"):
        for mesh in geometry.findall("mesh"):
            geometry.remove(mesh)
            ElementTree.SubElement(geometry, "sphere", radius=str(_SPHERE_M))
    for material in root.iter("material"):
        for texture in material.findall("texture"):
            material.remove(texture)
    return ElementTree.tostring(root)


if __name__ == "__main__":
    raise SystemExit(print_table("tests.robots.urdfs", __doc__, tuple(robots()), write_urdf))
