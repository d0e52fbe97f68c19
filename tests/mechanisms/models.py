"""Mechanisms with equality constraints, as MJCF: planar ones about z on a free base, and chains in space.

Digits of the tests are those of independent codes: elimination of the dependent coordinates, integrated by DOP853 at 1e-13.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.scenes import scene

HEAD = '<compiler angle="radian" autolimits="true"/><option gravity="0 0 0"/>'


def link(name: str, mass: float, inertia: float, centre: str, pos: str, joint: str, inner: str = "") -> str:
    """A link of a planar mechanism: inertia about z at its centre."""
    return (
        f'<body name="{name}" pos="{pos}">{joint}<inertial pos="{centre}" mass="{mass}" '
        f'diaginertia="{inertia} {inertia} {inertia}"/>{inner}</body>'
    )


def robot(mass: float, inertia: float, links: str, equality: str, actuator: str = "", tendon: str = "") -> str:
    """A robot on a free base with its mass centre at the origin."""
    return (
        f'<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="base"/><inertial pos="0 0 0" mass="{mass}" '
        f'diaginertia="{inertia} {inertia} {inertia}"/>{links}</body></worldbody><tendon>{tendon}</tendon>'
        f"<equality>{equality}</equality><actuator>{actuator}</actuator></mujoco>"
    )


def hinge(name: str, attributes: str = "") -> str:
    return f'<joint name="{name}" axis="0 0 1" {attributes}/>'


def geared(limit: str = "", *, gear: str = "-3", geom: str = "") -> str:
    """M1: two balanced wheels on a base; wheel B turns by ``gear`` times the angle of wheel A."""
    return robot(
        8,
        0.6,
        link("A", 1, 0.02, "0 0 0", ".3 0 0", hinge("A"), geom)
        + link("B", 0.5, 0.004, "0 0 0", "-.3 0 0", hinge("B", limit)),
        f'<joint joint1="B" joint2="A" polycoef="0 {gear} 0 0 0"/>',
        '<motor name="A" joint="A"/>',
    )


CHAIN = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="base"/>
  <inertial pos=".02 0 -.01" mass="12" diaginertia=".9 1.1 1.2"/>
  <body name="l1" pos=".3 .1 .1"><joint name="j1" axis="0 .6 .8" ref=".1" damping=".05"/>
   <inertial pos=".2 0 0" mass="2" diaginertia=".01 .04 .04"/>
   <body name="l2" pos=".4 0 0"><joint name="j2" axis="0 1 0" armature=".02"/>
    <inertial pos=".15 .02 0" mass="1.5" diaginertia=".006 .03 .03"/>
    <body name="l3" pos=".3 0 .05"><joint name="j3" axis=".6 0 .8" ref="-.2"/>
     <inertial pos=".1 0 .02" mass=".8" diaginertia=".003 .01 .01"/></body></body></body></body></worldbody>
 <equality><joint name="curve" joint1="j3" joint2="j1" polycoef=".05 .8 -.3 .2 -.1"/></equality>
 <actuator><motor name="m1" joint="j1"/><motor name="m2" joint="j2"/><motor name="m3" joint="j3"/></actuator></mujoco>"""
"""M2: three hinges in space; j3 = polynomial of j1, with reference angles."""


def four_bar(geom: str = "") -> str:
    """M3: crank, coupler and rocker on a base, as two chains that a connect joins at the end of coupler and rocker."""
    coupler = link("coupler", 0.8, 0.01, ".175 0 0", ".15 0 0", hinge("coupler"))
    return robot(
        5,
        0.4,
        link("crank", 0.5, 0.002, ".075 0 0", "0 .1 0", hinge("crank"), coupler + '<site name="x"/>')
        + link("rocker", 0.6, 0.004, ".125 0 0", ".4 .1 0", hinge("rocker"), geom + '<site name="end" pos=".25 0 0"/>'),
        '<connect name="pin" site1="pin" site2="end"/>',
        '<motor name="crank" joint="crank"/>',
    ).replace('<body name="coupler" pos=".15 0 0">', '<body name="coupler" pos=".15 0 0"><site name="pin" pos=".35 0 0"/>')


def parallelogram(bars: int = 3, *, off: float = 0.0) -> str:
    """M7: a coupler on two or three parallel bars of equal length; the third one is redundant, and may be off its place."""
    at, links = (0.0, 0.5, 0.25)[:bars], ""
    for i, x in enumerate(at):
        inner = f'<site name="end{i}" pos=".2 0 0"/>'
        if i == 0:
            sites = "".join(f'<site name="on{k}" pos="{at[k]} 0 0"/>' for k in range(1, bars))
            inner += link("coupler", 1, 0.02, ".25 .02 0", ".2 0 0", hinge("coupler"), sites)
        links += link(f"bar{i}", 0.4, 0.003, ".1 0 0", f"{x + off * (i == 2)} 0 0", hinge(f"bar{i}"), inner)
    pins = "".join(f'<connect name="pin{k}" site1="on{k}" site2="end{k}"/>' for k in range(1, bars))
    return robot(4, 0.3, links, pins)


SLIDER_CRANK = robot(
    5,
    0.4,
    link(
        "crank",
        0.5,
        0.002,
        ".075 0 0",
        "0 0 0",
        hinge("crank"),
        link("rod", 0.4, 0.003, ".15 0 0", ".15 0 0", hinge("rod"), '<site name="end" pos=".3 0 0"/>'),
    )
    + link("slider", 0.5, 0.001, "0 0 0", "0 0 0", '<joint name="slider" type="slide" axis="1 0 0"/>', '<site name="on"/>'),
    '<connect name="pin" site1="end" site2="on"/>',
)
"""A crank whose rod moves a slider along x."""


def five_bar() -> str:
    """Two driven cranks whose couplers meet at the tip: the arm of the tip is one crank and its coupler."""

    def side(name: str, x: float, inner: str) -> str:
        coupler = link(f"coupler_{name}", 0.4, 0.004, ".15 0 0", ".25 0 0", hinge(f"coupler_{name}"), inner)
        return link(f"crank_{name}", 0.6, 0.004, ".12 0 0", f"{x} .1 0", hinge(f"crank_{name}"), coupler)

    return robot(
        20,
        2,
        side("a", -0.15, '<site name="tip" pos=".3 0 0"/>') + side("b", 0.15, '<site name="end" pos=".3 0 0"/>'),
        '<connect name="pin" site1="tip" site2="end"/>',
        '<motor name="a" joint="crank_a"/><motor name="b" joint="crank_b"/>',
    )


def two_loops() -> str:
    """A crank whose end carries two couplers, each to a rocker of its own: both loops share its joint."""
    couplers = "".join(
        link(name, mass, 0.01, f"{length / 2} 0 0", ".15 0 0", hinge(name), f'<site name="{name}" pos="{length} 0 0"/>')
        for name, mass, length in (("c1", 0.8, 0.35), ("c2", 0.6, 0.3))
    )
    rockers = "".join(
        link(name, 0.6, 0.004, ".1 0 0", pos, hinge(name), f'<site name="{name}" pos=".25 0 0"/>')
        for name, pos in (("r1", ".4 .1 0"), ("r2", "-.3 -.05 0"))
    )
    crank = link("crank", 0.5, 0.002, ".075 0 0", "0 .1 0", hinge("crank"), couplers)
    pins = "".join(f'<connect name="pin{i}" site1="c{i}" site2="r{i}"/>' for i in (1, 2))
    return robot(5, 0.4, crank + rockers, pins)


WELDED = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="base"/>
  <inertial pos="0 0 0" mass="5" diaginertia=".9 1.1 1.2"/>
  <body name="child" pos=".3 .2 0"><joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
   <joint name="z" type="slide" axis="0 0 1"/><joint name="turn" type="ball"/>
   <inertial pos=".1 0 -.1" mass="2" diaginertia=".05 .08 .1"/></body></body></worldbody>
 <equality><weld name="joint" body1="base" body2="child" anchor=".05 .02 0"/></equality></mujoco>"""
"""M8: a body with six degrees of freedom on the base, welded to it."""


def turned(angle: float) -> list[float]:
    """Quaternion of a rotation about z."""
    return [float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2))]


ROCK = '<mujoco><option gravity="0 0 0"/><worldbody><body name="rock"><freejoint name="free"/>\
<inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/><geom name="rock" type="sphere" size="{size}" mass="0"/>\
</body></worldbody></mujoco>'


def rock(mass: float = 1.0, size: float = 0.1) -> str:
    """A ball."""
    return ROCK.format(mass=mass, size=size)


def mechanism(folder: Any, mjcf: str, joints: dict[str, Any], rates: dict[str, Any], **scenario: Any) -> Any:
    """A scenario with a mechanism, and a rock far away unless one is given."""
    given = {"objects": {"rock": rock()}} | scenario
    objects = given.pop("objects")
    away = {"rock/free": [0, 0, 90, 1, 0, 0, 0]} if "rock" in objects and "rock/free" not in joints else {}
    return scene(folder, mjcf, objects, **({"initial": {"joints": away | joints, "rates": rates}} | given))


def gripper(drive: str = 'tendon="pull"') -> str:
    """M6: a palm of 2 kg with two fingers of .1 kg on slides that close together, and one motor."""

    def finger(name: str, y: float) -> str:
        axis = "0 -1 0" if y > 0.0 else "0 1 0"
        return (
            f'<body name="{name}" pos="0 {y} 0"><joint name="{name}" type="slide" axis="{axis}"/>'
            '<inertial pos="0 0 0" mass=".1" diaginertia="1e-3 1e-3 1e-3"/>'
            f'<geom name="{name}" type="box" size=".005 .005 .005" mass="0"/></body>'
        )

    base = (
        '<joint name="px" type="slide" axis="1 0 0"/><joint name="py" type="slide" axis="0 1 0"/>'
        '<joint name="pt" axis="0 0 1"/>'
        '<inertial pos="0 0 0" mass="2" diaginertia=".1 .1 .1"/><site name="palm"/>'
    )
    return (
        f'<mujoco>{HEAD}<worldbody><body name="palm">{base}{finger("f1", 0.045)}{finger("f2", -0.045)}</body></worldbody>'
        '<tendon><fixed name="pull"><joint joint="f1" coef=".5"/><joint joint="f2" coef=".5"/></fixed></tendon>'
        f'<equality><joint joint1="f2" joint2="f1"/></equality><actuator><motor name="grip" {drive}/></actuator></mujoco>'
    )


def box(mass: float = 0.1) -> str:
    """A box of .04 m a side in the plane of the gripper."""
    return (
        f'<mujoco>{HEAD}<worldbody><body name="box"><joint name="bx" type="slide" axis="1 0 0"/>'
        '<joint name="by" type="slide" axis="0 1 0"/><joint name="bt" axis="0 0 1"/>'
        f'<inertial pos="0 0 0" mass="{mass}" diaginertia="1e-4 1e-4 1e-4"/>'
        '<geom name="box" type="box" size=".02 .02 .02" mass="0"/><site name="held"/></body></worldbody></mujoco>'
    )
