"""Mutations of model files: elements and attributes of MJCF removed, doubled, changed, and whole features put in."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from copy import deepcopy
from random import Random

from ffsm_mj.scenario.shipped import scenarios_dir
from tests.hostile.values import XML_NUMBERS, words

_TEXTS = (
    *("", " ", "x", "é"),
    *words("a/b robot/base world base joint_1 gripper box"),
    *("'", "%s%n", "../../etc/passwd", "/", "n" * 300, "日本語"),
    *words("true auto free plane sdf mesh hfield"),
    *("line 0", "a:b:1", "\t", "1", "-1"),
)
_TYPES = {
    "geom": ("plane", "hfield", "sdf", "mesh", "sphere", "capsule", "ellipsoid", "cylinder", "box", "none", ""),
    "joint": ("free", "ball", "slide", "hinge", "none"),
}
_COMMON = {
    "body": words("mocap gravcomp pos quat euler childclass xyaxes zaxis axisangle name user sleep"),
    "joint": words("""damping stiffness frictionloss armature range limited ref springref axis pos margin type
        springdamper solreflimit class name group actuatorfrcrange actuatorgravcomp"""),
    "geom": words("""size fromto mass density rgba pos quat type mesh hfield material contype name condim friction margin
        gap solref fluidshape fluidcoef group shellinertia class euler"""),
    "inertial": ("mass", "diaginertia", "fullinertia", "pos", "quat", "euler", "axisangle"),
    "motor": words("gear ctrlrange forcerange joint site tendon body refsite name ctrllimited group delay"),
    "option": words("""timestep gravity integrator density viscosity wind magnetic solver iterations tolerance impratio
        cone jacobian ccd_iterations ccd_tolerance o_margin actuatorgroupdisable sdf_initpoints"""),
    "compiler": words("""angle coordinate boundmass boundinertia balanceinertia inertiafromgeom fusestatic autolimits
        discardvisual meshdir assetdir texturedir settotalmass strippath eulerseq usethread
        inertiagrouprange"""),
    "site": ("pos", "size", "type", "rgba", "quat", "fromto", "name", "group"),
    "material": ("rgba", "texture", "texrepeat", "emission", "name", "class", "texuniform"),
    "include": ("file",),
    "default": ("class",),
    "mujoco": ("model",),
}
_WORDS = words("true false auto Euler implicit implicitfast RK4 degree local global XYZ xyz zzz elliptic")

_TOP = (
    '<equality><weld body1="{body}"/></equality>',
    '<equality><joint joint1="{joint}"/></equality>',
    '<equality><connect body1="{body}" anchor="0 0 0"/></equality>',
    '<equality><weld body1="{body}" body2="{body2}"/></equality>',
    '<tendon><fixed><joint joint="{joint}" coef="1"/></fixed></tendon>',
    '<tendon><fixed stiffness="1"><joint joint="{joint}" coef="1"/></fixed></tendon>',
    '<tendon><spatial damping="1"><site site="{site}"/><site site="{site}"/></spatial></tendon>',
    '<tendon><spatial><site site="{site}"/><geom geom="{geom}"/><site site="{site}"/></spatial></tendon>',
    '<tendon><fixed name="t"><joint joint="{joint}" coef="nan"/></fixed></tendon>',
    '<keyframe><key qpos="1 2 3"/></keyframe>',
    '<keyframe><key time="nan"/></keyframe>',
    "<keyframe><key/><key/></keyframe>",
    '<contact><pair geom1="{geom}" geom2="{geom}"/></contact>',
    '<contact><exclude body1="{body}" body2="{body2}"/></contact>',
    '<option gravity="0 0 -9.81"/>',
    '<option integrator="Euler"/>',
    '<option><flag contact="enable" limit="disable" gravity="disable" energy="enable"/></option>',
    '<option><flag eulerdamp="disable" multiccd="enable" nativeccd="disable" sleep="enable" island="enable"/></option>',
    '<compiler inertiafromgeom="true"/>',
    '<compiler settotalmass="1e-20"/>',
    '<compiler settotalmass="1e300"/>',
    '<compiler boundmass="1e308" boundinertia="1e308"/>',
    '<compiler fusestatic="true" discardvisual="true"/>',
    '<compiler balanceinertia="true"/>',
    '<compiler angle="degree" eulerseq="zyx" autolimits="false"/>',
    '<default><joint damping="1" armature="-1"/></default>',
    '<default><geom type="mesh"/></default>',
    '<default><geom density="0" mass="nan"/></default>',
    '<default class="other"><geom rgba="-inf 0 0 1"/></default>',
    "<default><default/></default>",
    '<size memory="1K"/>',
    '<size memory="-5"/>',
    '<size nuser_geom="-2" nuserdata="1000000"/>',
    '<size njmax="1" nconmax="1"/>',
    '<statistic meaninertia="nan" extent="-1"/>',
    '<visual><map znear="0"/><global offwidth="-1"/></visual>',
    '<custom><numeric name="n" size="100000000" data="1"/></custom>',
    '<custom><text name="t" data=""/></custom>',
    '<sensor><gyro site="{site}"/><touch site="{site}"/></sensor>',
    '<sensor><user dim="-1"/></sensor>',
    '<sensor><rangefinder site="{site}"/><jointpos joint="{joint}"/></sensor>',
    '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>',
    '<extension><plugin plugin="mujoco.sdf.torus"><instance name="t"/></plugin></extension>',
    '<extension><plugin plugin="no.such"/></extension>',
    '<actuator><position joint="{joint}" kp="1"/></actuator>',
    '<actuator><muscle joint="{joint}"/></actuator>',
    '<actuator><general joint="{joint}" dyntype="filter"/></actuator>',
    '<actuator><motor name="motor_1" joint="{joint}"/></actuator>',
    '<actuator><motor joint="{joint}" gear="0"/><velocity joint="{joint}" kv="nan"/></actuator>',
    '<actuator><adhesion body="{body}" ctrlrange="0 1"/></actuator>',
    '<actuator><motor site="{site}" gear="1 1 1 1 1 nan"/></actuator>',
    '<actuator><plugin plugin="mujoco.pid" joint="{joint}"/></actuator>',
    '<actuator><damper joint="{joint}" kv="1" ctrlrange="0 1"/><intvelocity joint="{joint}"/></actuator>',
    '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>',
    '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0"/></asset>',
    '<asset><mesh name="m" vertex="nan 0 0 1 0 0 0 1 0 0 0 1"/></asset>',
    '<asset><mesh name="m" file="nothing.stl"/></asset>',
    '<asset><mesh name="m" builtin="sphere" params="1"/></asset>',
    '<asset><hfield name="h" nrow="3" ncol="3" size="1 1 1 1"/></asset>',
    '<asset><hfield name="h" nrow="-3" ncol="3" size="1 1 1 1"/></asset>',
    '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
    '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="100000"/></asset>',
    '<asset><texture name="t" type="2d" builtin="checker" width="-4" height="4"/></asset>',
    '<asset><texture name="t" type="cube" file="{xml}"/></asset>',
    '<asset><texture name="t" type="2d" file="{xml}"/></asset>',
    '<asset><model name="o" file="{xml}"/></asset>',
    '<include file="{xml}"/>',
    '<include file="/dev/null"/>',
    '<include file="."/>',
    "<include/>",
    "<unknown/>",
    "<worldbody><body/></worldbody>",
    '<worldbody><body name="second"><freejoint/><geom size="0.1"/></body></worldbody>',
    '<worldbody><body mocap="true"><geom size="0.1"/></body></worldbody>',
    '<worldbody><geom type="plane" size="1 1 1"/></worldbody>',
    '<worldbody><camera mode="targetbody"/><light pos="nan 0 0"/></worldbody>',
    '<worldbody><composite type="cable" count="5 1 1" size="1"><geom type="capsule" size="0.01"/></composite></worldbody>',
    '<worldbody><flexcomp name="f" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" dim="2"/></worldbody>',
    '<worldbody><replicate count="3" offset="1 0 0"><body><freejoint/><geom size="0.1"/></body></replicate></worldbody>',
    '<worldbody><replicate count="100000000"><geom size="0.1"/></replicate></worldbody>',
    '<worldbody><attach model="none" body="b" prefix="p"/></worldbody>',
    '<worldbody><frame pos="nan 0 0"><geom size="1"/></frame></worldbody>',
)
_IN_BODY = (
    "<freejoint/>",
    "<freejoint/><freejoint/>",
    '<joint type="ball"/>',
    '<joint type="ball" damping="1"/>',
    '<joint type="slide" axis="0 0 0"/>',
    '<joint type="hinge" axis="nan 0 0"/>',
    '<joint type="hinge" range="1 -1" limited="true"/>',
    '<joint name="joint_1"/>',
    '<inertial pos="0 0 0" mass="1"/>',
    '<inertial pos="0 0 0" mass="nan" diaginertia="1 1 1"/>',
    '<inertial pos="0 0 0" mass="1e308" diaginertia="1 1 1"/>',
    '<inertial pos="0 0 0" mass="1" fullinertia="1 1 1 5 5 5"/>',
    '<inertial pos="nan 0 0" mass="1" diaginertia="1 1 1"/>',
    '<geom name="gripper" size="0.1"/>',
    '<geom type="plane" size="1 1 1" mass="0"/>',
    '<geom type="hfield" hfield="h" mass="0"/>',
    '<geom type="mesh" mesh="m" mass="0"/>',
    '<geom type="sdf" mesh="m" mass="0"><plugin plugin="mujoco.sdf.torus"/></geom>',
    '<geom type="box" size="1e5 1e5 1e5" mass="0"/>',
    '<geom type="sphere" size="1e300" mass="0"/>',
    '<geom type="box" size="0.1 0.1 0.1" mass="1e-300"/>',
    "<body/>",
    '<body><joint type="hinge"/></body>',
    '<body><freejoint/><geom size="0.1"/></body>',
    '<body mocap="true"/>',
    '<body gravcomp="1"><geom size="0.1"/></body>',
    '<body><joint/><inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/></body>',
    '<body><joint/><inertial pos="0 0 0" mass="1e-13" diaginertia="1e-13 1e-13 1e-13"/></body>',
    '<body><joint/><inertial pos="0 0 0" mass="1e200" diaginertia="1e200 1e200 1e200"/></body>',
    '<body><joint/><inertial pos="0 0 0" mass="1e-14" diaginertia="1 1 1"/></body>',
    '<plugin plugin="mujoco.elasticity.cable"/>',
    '<composite type="particle" count="2 2 2" spacing="0.5"><geom size="0.1"/></composite>',
    '<composite type="cable" curve="s" count="5 1 1" size="1"><geom type="capsule" size="0.01"/></composite>',
    '<flexcomp name="f" type="box" count="3 3 3" spacing="0.1 0.1 0.1" dim="3" mass="1"/>',
    '<flexcomp name="f" type="direct" dim="2" point="0 0 0 1 0 0 0 1 0" element="0 1 2"/>',
    '<camera fovy="nan"/>',
    '<light dir="0 0 0"/>',
    '<site name="tip"/>',
    '<include file="{xml}"/>',
    '<attach model="o" body="base" prefix="p"/>',
)


def model(name: str) -> ET.Element:
    """A shipped model with its includes put in."""
    folder = scenarios_dir().parent / "mjcf"
    root = ET.parse(folder / name).getroot()
    for parent in list(root.iter()):
        for i, child in reversed(list(enumerate(parent))):
            if child.tag == "include":
                parent[i : i + 1] = list(model(child.get("file", "")))
    return root


def xml(root: ET.Element) -> bytes:
    """Text of a model."""
    return ET.tostring(root, encoding="utf-8")


def mutate_model(rng: Random, root: ET.Element) -> None:
    """One to four mutations in place."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        rng.choice(_MUTATIONS)(rng, root)


def _numbers(rng: Random, like: str) -> str:
    """As many numbers as an attribute had, one of them or all of them special; sometimes too many or too few."""
    parts = like.split() or ["1"]
    if rng.random() < 0.2:
        parts = parts[: rng.randrange(len(parts) + 1)] + ["1"] * rng.randrange(3)
    if parts and rng.random() < 0.6:
        parts[rng.randrange(len(parts))] = rng.choice(XML_NUMBERS)
        return " ".join(parts)
    return " ".join([rng.choice(XML_NUMBERS)] * len(parts))


def _is_number(text: str) -> bool:
    try:
        [float(part) for part in text.split()]
    except ValueError:
        return False
    return True


def _change(rng: Random, root: ET.Element) -> None:
    elements = [e for e in root.iter() if e.attrib]
    if elements:
        element = rng.choice(elements)
        name = rng.choice(list(element.attrib))
        old = element.attrib[name]
        element.set(name, _numbers(rng, old) if _is_number(old) else rng.choice(_TEXTS))


def scale_numbers(rng: Random, root: ET.Element) -> None:
    """Numbers that stay numbers, some powers of ten away or with the other sign: most such models are taken, and run."""
    numbers = [(e, name) for e in root.iter() for name, text in e.attrib.items() if _is_number(text) and text.split()]
    for element, name in rng.sample(numbers, min(len(numbers), rng.choice((1, 1, 2, 4)))):
        parts = element.attrib[name].split()
        i = rng.randrange(len(parts))
        parts[i] = repr(float(parts[i]) * rng.choice((-1.0, 1.0, 1.0, 1.0)) * 10.0 ** rng.randint(-12, 12))
        element.set(name, " ".join(parts))


def _inertia(rng: Random, root: ET.Element) -> None:
    elements = [e for e in root.iter() if e.tag in ("inertial", "geom")]
    if elements:
        element = rng.choice(elements)
        name = rng.choice(
            ("mass", "diaginertia", "pos") if element.tag == "inertial" else ("mass", "size", "rgba", "pos", "fromto")
        )
        element.set(name, _numbers(rng, element.get(name, "1 1 1" if name != "mass" else "1")))


def _add_attribute(rng: Random, root: ET.Element) -> None:
    element = rng.choice([e for e in root.iter() if e.tag in _COMMON] or [root])
    name = rng.choice(_COMMON.get(element.tag, ("name",)))
    word = rng.choice(_TYPES[element.tag]) if name == "type" and element.tag in _TYPES else rng.choice((*_TEXTS, *_WORDS))
    element.set(name, rng.choice((_numbers(rng, "1 1 1"), _numbers(rng, "1"), word, word)))


def _drop_attribute(rng: Random, root: ET.Element) -> None:
    elements = [e for e in root.iter() if e.attrib]
    if elements:
        element = rng.choice(elements)
        del element.attrib[rng.choice(list(element.attrib))]


def _children(root: ET.Element) -> list[tuple[ET.Element, ET.Element]]:
    return [(parent, child) for parent in root.iter() for child in parent]


def _remove(rng: Random, root: ET.Element) -> None:
    pairs = _children(root)
    if pairs:
        parent, child = rng.choice(pairs)
        parent.remove(child)


def _remove_kind(rng: Random, root: ET.Element) -> None:
    kind = rng.choice(
        ("joint", "freejoint", "inertial", "geom", "site", "motor", "body", "option", "asset", "default", "actuator")
    )
    for parent, child in _children(root):
        if child.tag == kind and rng.random() < 0.8 and child in list(parent):
            parent.remove(child)


def _double(rng: Random, root: ET.Element) -> None:
    pairs = _children(root)
    if pairs:
        parent, child = rng.choice(pairs)
        parent.append(deepcopy(child))


def _move(rng: Random, root: ET.Element) -> None:
    pairs = _children(root)
    if pairs:
        parent, child = rng.choice(pairs)
        parent.remove(child)
        rng.choice(list(root.iter())).append(child)


def _retag(rng: Random, root: ET.Element) -> None:
    tags = sorted({e.tag for e in root.iter()})
    rng.choice(list(root.iter())).tag = rng.choice(
        (*tags, "unknown", "plugin", "frame", "composite", "flexcomp", "urdf", "robot")
    )


def _shape(rng: Random, root: ET.Element) -> None:
    """An impact geom of another kind."""
    geoms = [e for e in root.iter() if e.get("name") in ("gripper", "box", "hull", "panel", "nozzle", "base")]
    if geoms:
        rng.choice(geoms).set("type", rng.choice(_TYPES["geom"]))


def _snippet(rng: Random, root: ET.Element) -> None:
    bodies = [e for e in root.iter() if e.tag == "body"]
    inside = rng.random() < 0.45 and bool(bodies)

    def any_name(tag: str) -> str:
        names = [e.get("name", "") for e in root.iter() if e.tag == tag and e.get("name")]
        return rng.choice(names) if names and rng.random() < 0.9 else "nobody"

    text = rng.choice(_IN_BODY if inside else _TOP)
    for name in ("body2", "body", "joint", "site", "geom"):
        text = text.replace("{" + name + "}", any_name(name.removesuffix("2")))
    text = text.replace("{xml}", rng.choice(("robot.xml", "object.xml", "nothing.xml", "scenario.yaml")))
    parent = rng.choice(bodies) if inside else root
    parent.extend(ET.fromstring(f"<x>{text}</x>"))


def _same_names(rng: Random, root: ET.Element) -> None:
    named = [e for e in root.iter() if e.get("name")]
    if named:
        rng.choice(named).set("name", rng.choice((rng.choice(named).get("name", ""), rng.choice(_TEXTS))))


_MUTATIONS: tuple[Callable[[Random, ET.Element], None], ...] = (
    *(_change, _change, _inertia, _inertia, _add_attribute, _add_attribute, _drop_attribute, _remove, _remove_kind),
    *(_double, _move, _retag, _shape, _snippet, _snippet, _snippet, _same_names),
)
