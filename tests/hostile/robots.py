"""Robots as vendors write them, URDF and MJCF with meshes, and mutations of all their files."""

from __future__ import annotations

import struct
import xml.etree.ElementTree as ET
from random import Random

from tests.hostile.mjcf_mutations import mutate_model, xml
from tests.hostile.mjcf_mutations import scale_numbers as scale_model
from tests.hostile.values import XML_NUMBERS
from tests.hostile.yaml_mutations import mutate_bytes

_INERTIA = '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>'
_URDF = """<robot name="vendor">
  <link name="foot"><inertial><mass value="3"/>{inertia}</inertial>
    <collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
  <joint name="swing" type="revolute"><parent link="foot"/><child link="boom"/><origin xyz="0 0 0.1" rpy="0 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="1"/><dynamics damping="0.5" friction="0.1"/></joint>
  <link name="boom"><inertial><origin xyz="0 0 0.2" rpy="0.1 0 0"/><mass value="1"/>{inertia}</inertial>
    <visual><geometry><mesh filename="{mesh}" scale="1 1 1"/></geometry><material name="m"><color rgba="1 0 0 1"/></material>
    </visual><collision><origin xyz="0 0 0.2"/><geometry><mesh filename="{mesh}"/></geometry></collision></link>
  <joint name="reach" type="prismatic"><parent link="boom"/><child link="hand"/><origin xyz="0 0 0.45"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.3" effort="20" velocity="1"/></joint>
  <link name="hand"><inertial><mass value="0.3"/>{inertia}</inertial>
    <collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="finger" type="continuous"><parent link="hand"/><child link="tip"/><axis xyz="1 0 0"/>{mimic}</joint>
  <link name="tip"><inertial><mass value="0.1"/>{inertia}</inertial>
    <collision><geometry><cylinder radius="0.02" length="0.1"/></geometry></collision></link>{more}
</robot>"""
_MORE = (
    "",
    "<mujoco><compiler discardvisual='false' balanceinertia='true' fusestatic='false'/></mujoco>",
    "<mujoco><compiler meshdir='..' strippath='false'/></mujoco>",
    "<mujoco><option gravity='0 0 -9.81'/></mujoco>",
)
_MIMIC = ("", "<mimic joint='swing'/>", "<mimic joint='finger' multiplier='nan'/>", "<mimic joint='\x1f' offset='1e300'/>")
_MESHES = ("a.stl", "a.obj", "package://vendor/a.stl", "../outside/precious", "/etc/passwd", "", "file:///dev/zero", "a.dae")
_VENDOR = """<mujoco model="vendor"><compiler angle="radian" meshdir="."/><asset><mesh name="m" file="a.{form}"/></asset>
  <worldbody><body name="foot"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="3"/>
    <body name="boom" pos="0 0 0.1"><joint name="swing" axis="0 1 0" range="-2 2" damping="0.5"/>
      <geom name="m" type="mesh" mesh="m" mass="1"/>
      <body name="hand" pos="0 0 0.45"><joint name="reach" type="slide" axis="0 0 1"/><geom size="0.05" mass="0.3"/></body>
    </body></body></worldbody><actuator><position joint="swing" kp="10"/></actuator></mujoco>"""
_CORNERS = ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, 0.0, 0.4))
_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
_DOUBLES = ("nan", "inf", "1e38", "-1e38", "1e-38", "0", "1e999", "x", "")


def stl() -> bytes:
    """A tetrahedron as binary STL."""
    faces = b"".join(struct.pack("<12fH", 0, 0, 1, *(x for c in face for x in _CORNERS[c]), 0) for face in _FACES)
    return bytes(80) + struct.pack("<I", len(_FACES)) + faces


def obj() -> bytes:
    """The same as OBJ."""
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in _CORNERS)
    return (corners + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in _FACES)).encode()


def _odd_stl(rng: Random, data: bytes) -> bytes:
    found = bytearray(data)
    if rng.random() < 0.3:
        found[80:84] = struct.pack("<I", rng.choice((0, 1, 3, 5, 2**31, 2**32 - 1)))
    else:
        at = 84 + 4 * rng.randrange((len(found) - 84) // 4)
        found[at : at + 4] = struct.pack("<f", rng.choice((float("nan"), float("inf"), 1e38, -1e38, 1e-38, 0.0)))
    return bytes(found)


def _odd_obj(rng: Random, data: bytes) -> bytes:
    lines = data.decode().splitlines()
    at = rng.randrange(len(lines))
    words = lines[at].split()
    words[rng.randrange(len(words))] = rng.choice((*_DOUBLES, "-1", "99999999", "f", "v", "mtllib ../outside/precious", "l"))
    lines[at] = " ".join(words)
    return "\n".join(rng.choice((lines, lines[::-1], lines * 2))).encode()


def meshes(rng: Random) -> dict[str, bytes]:
    """Mesh files, some of them odd."""
    found = {"a.stl": stl(), "a.obj": obj(), "vendor/a.stl": stl(), "vendor/package.xml": b"<package/>"}
    if rng.random() < 0.3:
        name = rng.choice(("a.stl", "a.obj", "vendor/a.stl"))
        odd = _odd_obj if name.endswith("obj") else _odd_stl
        found[name] = rng.choice((odd, odd, mutate_bytes))(rng, found[name])
    return found


def robot(rng: Random) -> tuple[str, bytes]:
    """A robot's file: its name and what it holds."""
    if rng.random() < 0.35:
        root = ET.fromstring(_VENDOR.replace("{form}", rng.choice(("stl", "obj"))))
        rng.choice((mutate_model, scale_model, scale_model, lambda *_: None))(rng, root)
        return "robot.xml", xml(root)
    mesh, mimic, more = (rng.choice(each) if rng.random() < 0.15 else each[0] for each in (_MESHES, _MIMIC, _MORE))
    inertia = _INERTIA.replace("{i}", rng.choice(("0.02",) * 12 + ("0", "-1", "1e300")))
    text = _URDF
    for key, value in {"inertia": inertia, "mesh": mesh, "mimic": mimic, "more": more}.items():
        text = text.replace("{" + key + "}", value)
    kind = rng.random()
    if kind < 0.1:
        return "robot.urdf", mutate_bytes(rng, text.encode())
    try:
        root = ET.fromstring(text)
    except ET.ParseError:
        return "robot.urdf", text.encode()
    for _ in range(rng.choice((0, 0, 1, 1, 1, 2))):
        _odd_urdf(rng, root)
    return "robot.urdf", xml(root)


def _odd_urdf(rng: Random, root: ET.Element) -> None:
    """An attribute, an element or a name that is not what it was."""
    elements = [e for e in root.iter() if e.attrib]
    if not elements:
        return
    element, kind = rng.choice(elements), rng.choice((0, 1, 2, 3, 3, 3, 3, 4))
    name = rng.choice(list(element.attrib))
    if kind == 0:
        parts = element.attrib[name].split() or [""]
        parts[rng.randrange(len(parts))] = rng.choice(XML_NUMBERS)
        element.set(name, " ".join(parts))
    elif kind == 1:
        element.set(name, rng.choice(elements).attrib.get(name, "\u202e$x$ \u00e9"))
    elif kind == 2:
        del element.attrib[name]
    elif kind == 3:
        scale_model(rng, root)
    else:
        parents = [(p, c) for p in root.iter() for c in p]
        parent, child = rng.choice(parents)
        rng.choice((parent.remove, parent.append))(child)
