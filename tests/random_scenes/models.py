"""Models of random scenes as MJCF: a robot on a floating base with up to two arms, and objects."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from tests.random_scenes.dice import Dice, numbers
from tests.random_scenes.pieces import Drawn, pieces, wall

KINDS = ("sphere", "capsule", "box", "cylinder", "ellipsoid", "mesh")
BASES = ("free", "free", "free", "planar", "planar", "ball")
"""Of the robot: spatial ones, in a plane, and one that turns about a point."""


@dataclass
class Actuator:
    """An actuator of the robot: ``kind`` is ``joint``, ``jet``, ``torquer`` or ``wheel``; ``size`` is a usual effort."""

    name: str
    kind: str
    unit: str
    size: float


@dataclass
class Model:
    """A model, and what scenarios and sensors may name of it (without the prefix)."""

    base: str
    xml: str = ""
    geoms: list[str] = field(default_factory=list)
    """What rules name: its geoms, and bodies of several pieces."""
    joints: list[str] = field(default_factory=list)
    """Joints other than those of the base and wheels, without ball joints."""
    slides: list[str] = field(default_factory=list)
    limited: list[str] = field(default_factory=list)
    balls: list[str] = field(default_factory=list)
    actuators: list[Actuator] = field(default_factory=list)
    tips: list[str] = field(default_factory=list)
    arms: list[list[str]] = field(default_factory=list)
    """Joints of each arm."""
    grips: list[str] = field(default_factory=list)
    """What rules name of the ends of arms."""
    keys: dict[str, Any] = field(default_factory=dict)
    """Further keys of its model in the scenario."""

    @property
    def base_joints(self) -> dict[str, int]:
        """Joints of the base, with the number of their coordinates."""
        return {"free": {"free": 7}, "planar": {"x": 1, "y": 1, "yaw": 1}, "ball": {"ball": 4}}[self.base]


@dataclass
class Wall:
    """A fixed body: its file, the file by which it is placed, what rules name, and further keys of the scenario."""

    xml: str
    apart: str
    side: str
    keys: dict[str, Any]


class ModelDrawing:
    """Draws the models of one scene.

    Args:
        seed: The seed.
        step_s: Time step, by which springs and dampers are bounded.
        gravity: Gravity, m/s^2.
        presses: Whether the robot presses objects away from itself: its first joint then is a slide along x.
        flat: Everything moves in the plane z = 0.
        aligned: Geoms and links are not turned, so that faces, edges and axes are parallel to the last bit.
    """

    def __init__(self, seed: int, step_s: float, gravity: list[float], *, presses: bool, flat: bool, aligned: bool) -> None:
        self.seed, self.step_s, self.presses, self.flat = seed, step_s, presses, flat
        self.aligned, self.gravity = aligned, any(gravity)
        self.head = f'<compiler angle="radian"/><option gravity="{numbers(gravity)}"/>'
        self.dice = Dice(seed, "models")
        self.elastic = Dice(seed, "elastic")
        self.sprung = self.elastic.chance(0.3)
        self.stopped = Dice(seed, "limits").chance(0.4)
        self.cut = Dice(seed, "pieces").chance(0.35)

    def robot(self, base: str) -> Model:
        dice, made = self.dice, Model(base)
        assets, fittings, actuators = "", "", ""
        bus, asset = self.geom(made, "bus", 0.2, body="base")
        assets += asset
        arms, links = dice.pick([1, 1, 2]), 0
        bodies = ""
        for arm in range(arms):
            count = dice.integer(1, 3)
            text, asset = self._arm(made, arm, links, count, 0.0 if arms == 1 else (-0.2, 0.2)[arm])
            bodies, assets, links = bodies + text, assets + asset, links + count
        for name in made.joints:
            if dice.chance(0.9):
                slides = name in made.slides
                actuators += f'<motor name="m_{name}" joint="{name}"/>'
                size = dice.log_between(0.3, 10.0) * (1.0 if slides else 0.15)
                made.actuators.append(Actuator(f"m_{name}", "joint", "N" if slides else "N_m", size))
        fit = Dice(self.seed, "fittings")
        if fit.chance(0.4) and base == "free":
            fittings += f'<site name="jet" pos="-0.2 0.05 0.02" quat="{numbers(fit.turn())}"/>'
            actuators += '<motor name="jet" site="jet" gear="1 0 0 0 0 0"/>'
            actuators += '<motor name="torquer" site="jet" gear="0 0 0 0 1 0"/>'
            made.actuators += [
                Actuator("jet", "jet", "N", fit.between(0.5, 5.0)),
                Actuator("torquer", "torquer", "N_m", fit.between(0.05, 0.5)),
            ]
        if base == "planar" and fit.chance(0.4):
            for joint, unit, size in (("x", "N", 3.0), ("y", "N", 3.0), ("yaw", "N_m", 0.5)):
                actuators += f'<motor name="push_{joint}" joint="{joint}"/>'
                made.actuators.append(Actuator(f"push_{joint}", "jet", unit, fit.between(0.2, 1.0) * size))
        if fit.chance(0.4):
            axis = [0.0, 0.0, 1.0] if self.flat else fit.direction()
            fittings += f"""<body name="wheel" pos="-0.1 0 0.05"><joint name="wheel" axis="{numbers(axis)}"/>
              <inertial pos="0 0 0" mass="0.5" diaginertia="0.002 0.002 0.004"/></body>"""
            actuators += '<motor name="wheel" joint="wheel"/>'
            made.actuators.append(Actuator("wheel", "wheel", "N_m", fit.between(0.01, 0.1)))
        if made.limited and fit.chance(0.1):
            made.keys["limits"] = "ignore"
        if fit.chance(0.1):
            made.keys["joint_flex"] = self._flex(made)
        if self.sprung and fit.chance(0.1):
            made.keys["strip"] = [fit.pick(["stiffness", "damping"])]
        made.xml = f"""<mujoco model="robot">{self.head}<asset>{assets}</asset><worldbody><body name="base">
          {self._base(base)}{self.inertial(dice.log_between(4.0, 100.0), 0.4)}{bus}<site name="imu" pos="0.02 0.01 -0.03"
          quat="{numbers(dice.turn(0.5))}"/>{fittings}{bodies}</body></worldbody><actuator>{actuators}</actuator>
          SENSORS</mujoco>"""
        return made

    def object(self, name: str, base: str) -> Model:
        """A floating object, in a fifth of the cases with a panel on a joint of any kind."""
        dice, made = self.dice, Model(base)
        size = dice.between(0.08, 0.25)
        geom, asset = self.geom(made, name, size, body=name)
        if dice.chance(0.2):
            place = self._in_plane(dice.vector(0.5 * size))
            second, more = self.geom(made, f"{name}b", 0.6 * size, (place[0], place[1], place[2]))
            geom, asset = geom + second, asset + more
        panel = ""
        if self.elastic.chance(0.2):
            kind = "hinge" if self.flat else self.elastic.pick(["hinge", "slide", "ball"])
            made.balls += ["panel"] if kind == "ball" else []
            made.joints += [] if kind == "ball" else ["panel"]
            axis = [0.0, 0.0, 1.0] if self.flat else self.elastic.direction()
            panel = f"""<body name="panel" pos="{numbers([0.0, 1.5 * size, 0.0])}">
              <joint name="panel" type="{kind}" axis="{numbers(axis)}" {self._spring(0.3 * size**2)}/>
              {self.inertial(self.elastic.between(0.1, 0.5), size)}</body>"""
        sites = ""
        for site in ("handle", "knob"):
            place = self._in_plane(dice.vector(0.5 * size))
            sites += f'<site name="{site}" pos="{numbers(place)}" quat="{numbers(self._turn(1.0))}"/>'
        made.xml = f"""<mujoco model="{name}">{self.head}<asset>{asset}</asset><worldbody><body name="{name}">
          {self._base(base)}{self.inertial(dice.log_between(0.3, 30.0), size)}{geom}{sites}{panel}
          </body></worldbody></mujoco>"""
        return made

    def wall(self, name: str) -> Wall:
        """A fixed box, thick or thin, whose face looks along -x, a post of any shape, pieces, terrain or a cone."""
        made = Model("")
        if self.dice.chance(0.25):
            geom, asset = self.geom(made, name, 0.4)
        else:
            half = "0.3 1 1" if self.dice.chance(0.6) else f"{self.dice.between(0.02, 0.1)} 0.4 0.5"
            geom, asset = f'<geom name="{name}" type="box" size="{half}" mass="0"/>', ""
        drawn = Drawn(geom, asset, {}, f"{name}/{name}", geom)
        if self.cut:
            drawn = wall(Dice(self.seed, f"pieces of {name}"), name) or drawn
        xml, apart = (
            f"""<mujoco model="{name}">{self.head}<asset>{drawn.assets}</asset><worldbody>{text}</worldbody></mujoco>"""
            for text in (drawn.geoms, drawn.apart)
        )
        return Wall(xml, apart, drawn.side, drawn.keys)

    def _arm(self, made: Model, arm: int, first: int, count: int, side: float) -> tuple[str, str]:
        dice, body, ends, assets = self.dice, "", "", ""
        for i in range(first, first + count):
            slides = dice.chance(0.35) or (self.presses and i == 0)
            axis = np.array([0.0, 0.0, 1.0]) if self.flat else dice.rng.normal(size=3)
            if slides and (self.presses or self.flat or dice.chance(0.7)):
                axis = np.array([1.0, 0.1 * dice.rng.normal(), 0.0 if self.flat else 0.1 * dice.rng.normal()])
            name = f"j{i}"
            made.joints.append(name)
            made.slides += [name] if slides else []
            place = [0.35, side, 0.0] if i == first else [0.25, 0.0, 0.0]
            last = i == first + count - 1
            geom, asset = self.geom(made, f"link{i}", 0.09 if last else 0.05, (0.12, 0.0, 0.0), body=f"link{i}")
            made.grips += [made.geoms[-1]] if last else []
            assets += asset
            turn = self._turn(0.2 * last * (not self.aligned))
            body += f"""<body name="link{i}" {self._floats(i)} pos="{numbers(place)}" quat="{numbers(turn)}">
              <joint name="{name}" type="{"slide" if slides else "hinge"}" axis="{numbers(axis / np.linalg.norm(axis))}"
              {self._limits(made, name)} {self._spring(1.0 if slides else 0.05)} {self._armature()}/>
              {self.inertial(dice.between(0.3, 3.0), 0.15)}{geom}"""
            ends += "</body>"
        made.arms.append(made.joints[first:])
        tip = f"tip{arm}"
        made.tips.append(tip)
        place = [0.2, *self._in_plane([0.0, *(0.03 * dice.rng.normal(size=2))])[1:]]
        site = f'<site name="{tip}" pos="{numbers(place)}" quat="{numbers(self._turn(0.7))}"/>'
        return body + site + ends, assets

    def _floats(self, i: int) -> str:
        """A link whose weight MuJoCo compensates."""
        return 'gravcomp="1"' if self.gravity and Dice(self.seed, f"weight of link{i}").chance(0.15) else ""

    def _flex(self, made: Model) -> dict[str, Any]:
        """A flexible drive of the first joint: h w stays below 0.2 with the reflected inertia of the rotor."""
        dice = Dice(self.seed, "flex")
        name = made.joints[0]
        inertia = 0.05 if name in made.slides else 0.005
        rate = min(dice.log_between(3.0, 60.0), 0.1 / self.step_s)
        return {
            name: {
                "stiffness": inertia * rate**2,
                "damping": 0.05 * inertia * rate,
                "gear": 10.0,
                "rotor_inertia": inertia / 100.0,
            }
        }

    def _base(self, base: str) -> str:
        return {
            "free": '<freejoint name="free"/>',
            "planar": """<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
              <joint name="yaw" axis="0 0 1"/>""",
            "ball": '<joint name="ball" type="ball" pos="0.1 0.05 -0.1"/>',
        }[base]

    def _limits(self, made: Model, name: str) -> str:
        dice = Dice(self.seed, f"limits of {name}")
        if not (self.stopped and dice.chance(0.6)):
            return ""
        made.limited.append(name)
        reach = 0.3 if name in made.slides else 1.2
        return f'limited="true" range="{numbers([-reach * dice.between(0.05, 1.0), reach * dice.between(0.05, 1.0)])}"'

    def _spring(self, inertia: float) -> str:
        """A spring, a damper or both in half of the joints of an elastic scene; ``inertia``: what the joint moves at least.

        Up to three of them act on a light link: h w stays below 0.3 and h d / I below 2.7, which the program refuses.
        """
        dice, h = self.elastic, self.step_s
        if not (self.sprung and dice.chance(0.5)):
            return ""
        light = 0.1 * inertia
        rate = min(dice.log_between(1.0, 60.0), 0.08 / h)
        text = f'stiffness="{numbers(light * rate**2)}" springref="{numbers(0.1 * dice.rng.normal())}"'
        damping = f'damping="{numbers(light * dice.log_between(0.1, min(50.0, 0.3 / h)))}"'
        return dice.pick([text, damping, f"{text} {damping}"])

    def _armature(self) -> str:
        dice = self.elastic
        return f'armature="{numbers(dice.log_between(1e-4, 1e-2))}"' if dice.chance(0.2) else ""

    def _in_plane(self, place: list[float]) -> list[float]:
        return [*place[:2], 0.0] if self.flat else place

    def _turn(self, share: float) -> list[float]:
        if not self.flat:
            return self.dice.turn(share)
        angle = self.dice.between(-math.pi, math.pi) if self.dice.chance(share) else 0.0
        return [math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)]

    def inertial(self, mass: float, size: float) -> str:
        """Of a body that is a body: principal moments are sums of two squares."""
        dice = self.dice
        a, b, c = mass * (size * dice.rng.uniform(0.3, 1.0, 3)) ** 2
        place = self._in_plane(dice.vector(0.2 * size)) if dice.chance(0.7) else [0.0, 0.0, 0.0]
        quat, moments = numbers(self._turn(0.7)), numbers([b + c, a + c, a + b])
        return f'<inertial pos="{numbers(place)}" quat="{quat}" mass="{mass}" diaginertia="{moments}"/>'

    def geom(
        self, made: Model, name: str, size: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0), *, body: str = ""
    ) -> tuple[str, str]:
        """A geom of any convex kind, or several pieces instead of it if its body may have them.

        Args:
            made: Its model, to which what rules name of it is added.
            name: Its name.
            size: Its size, m.
            at: Its position, m.
            body: The body that rules name if it becomes several geoms; empty: it does not.

        Returns:
            Its element and that of its mesh, if it has one.
        """
        dice, cuts = self.dice, Dice(self.seed, f"pieces of {name}")
        made.geoms.append(name)
        kind = dice.pick(KINDS)
        a, b, c = (size * dice.rng.uniform(0.5, 1.3, 3)).tolist()
        turn = self._turn(0.6 * (not self.aligned))
        place = f'name="{name}" pos="{numbers(at)}" quat="{numbers(turn)}" mass="0"'
        if body and self.cut and cuts.chance(0.6):
            drawn = pieces(cuts, name, np.array([a, b, c]), np.array(at), np.array(turn))
            if mesh := drawn.keys.get("decompose"):
                made.keys.setdefault("decompose", []).append(mesh)
            else:
                made.geoms[-1] = body
            return drawn.geoms, drawn.assets
        if kind == "mesh":
            points = self._vertices() * (a, b, c)
            asset = f'<mesh name="{name}" vertex="{numbers(points.ravel())}"/>'
            return f'<geom {place} type="mesh" mesh="{name}"/>', asset
        sizes = {"sphere": [a], "capsule": [a, b], "cylinder": [a, b]}.get(kind, [a, b, c])
        return f'<geom {place} type="{kind}" size="{numbers(sizes)}"/>', ""

    def _vertices(self) -> np.ndarray:
        """Of a mesh of about unit size: of a random hull, or with faces that are flat to single precision only."""
        dice = self.dice
        kind = dice.pick(["hull", "hull", "frustum", "prism", "grid"])
        if kind == "frustum":
            top = dice.between(0.4, 1.0)
            return np.array([[x * s, y * s, z] for z, s in ((-1, 1), (1, top)) for x in (-1, 1) for y in (-1, 1)])
        if kind == "prism":
            angles = 2.0 * math.pi * np.arange(count := dice.integer(3, 11)) / count
            return np.array([[math.cos(angle), math.sin(angle), z] for z in (-1, 1) for angle in angles])
        if kind == "grid":
            return np.array([*product((-1.0, 0.0, 1.0), repeat=3)])
        points = dice.rng.normal(size=(dice.integer(6, 15), 3))
        return points / np.linalg.norm(points, axis=1)[:, None]
