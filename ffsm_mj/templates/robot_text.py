"""The files of a new scenario as text: models as MJCF, the scenario as commented YAML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

from ffsm_mj.model.source import unused
from ffsm_mj.templates.vendor import Vendor
from ffsm_mj.yaml import write_flow


@dataclass(frozen=True)
class Base:
    """A cuboid of uniform density: its mass in kg, half its edges in m, (3,)."""

    mass: float
    halves: tuple[float, float, float]

    @property
    def inertia(self) -> tuple[float, ...]:
        """Moments of inertia about the axes through its centre, kg m^2."""
        x, y, z = (half**2 for half in self.halves)
        return tuple(rounded(self.mass * sum_ / 3.0, 4) for sum_ in (y + z, z + x, x + y))

    @property
    def description(self) -> str:
        """In words."""
        edges, moments = (list(dict.fromkeys(values)) for values in ([2.0 * half for half in self.halves], self.inertia))
        shape = (
            f"a cube of {edges[0]:g} m" if len(edges) == 1 else f"{' x '.join(f'{2 * half:g}' for half in self.halves)} m"
        )
        return f"{self.mass:g} kg, {shape}, moments of inertia {', '.join(f'{one:g}' for one in moments)} kg m^2"


@dataclass(frozen=True)
class Approach:
    """Place of the ball at the start, m, and its velocity, m/s: it meets the tip after one second."""

    place: list[float]
    velocity: list[float]


@dataclass(frozen=True)
class Start:
    """Keys of the scenario that describe its start.

    Attributes:
        pose: Coordinates of the joints at the start, rad or m.
        tip: Name of the site.
        on: Body that it is added to, and its place there, m; None where the robot's file has it.
        target: Its place in the world at the start, m.
        approach: How a ball meets the tip; None without a ball.
        without_ball: Why there is no ball; empty if there is one.
        kp: Gain of each joint that motors drive; empty where servos drive some.
        kd: Gain of each such joint.
        servos: Whether servos drive joints.
    """

    pose: dict[str, float]
    tip: str
    on: tuple[str, list[float]] | None
    target: list[float]
    approach: Approach | None
    without_ball: str
    kp: list[float]
    kd: list[float]
    servos: bool

    @property
    def description(self) -> str:
        """The tip in words."""
        return f"site {self.tip!r}" + (f", added to body {self.on[0]!r} at {self.on[1]} m" if self.on else " of the file")


@dataclass(frozen=True)
class Places:
    """Paths relative to the scenario: the robot's model, folders of its files, and packages that it names."""

    model: str
    folders: list[str]
    packages: list[str]


def rounded(value: float, digits: int) -> float:
    """A number to some significant digits."""
    return float(f"{value:.{digits}g}")


def model_text(name: str, vendor: Vendor, base: Base | None, file: str) -> str:
    """MJCF of the robot: its file attached, to a base where it has none that floats."""
    attached = f'<attach model="vendor"{f" body={quoteattr(vendor.root)}" if vendor.root else ""} prefix=""/>'
    body = f"    {attached}" if base is None else _base_text(base, attached, vendor)
    motors = [motor_text(joint, most, vendor) for joint, most in vendor.motors.items()]
    actuators = ["  <actuator>", *motors, "  </actuator>"] if motors else []
    lines = [
        f"<mujoco model={quoteattr(name)}>",
        '  <option gravity="0 0 0"/>',
        "  <asset>",
        "    <!-- The vendor's file, as it is. -->",
        f'    <model name="vendor" file={quoteattr(file)}/>',
        "  </asset>",
        "  <worldbody>",
        body,
        "  </worldbody>",
        *actuators,
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _base_text(base: Base, attached: str, vendor: Vendor) -> str:
    bus, hull = unused("bus", vendor.names), unused("bus_hull", vendor.names)
    inertia, half = (" ".join(f"{value:g}" for value in values) for values in (base.inertia, base.halves))
    return "\n".join(
        [
            f'    <body name="{bus}">',
            f'      <freejoint name="{unused("bus_free", vendor.names)}"/>',
            "      <!-- A cuboid of uniform density: mass in kg, moments of inertia in kg m^2. -->",
            f'      <inertial pos="0 0 0" mass="{base.mass:g}" diaginertia="{inertia}"/>',
            f'      <geom name="{hull}" type="box" size="{half}" mass="0"/>',
            "      <!-- The robot stands on its upper face. -->",
            f'      <frame pos="0 0 {base.halves[2]:g}">',
            f"        {attached}",
            "      </frame>",
            "    </body>",
        ]
    )


def motor_text(joint: str, most: float | None, vendor: Vendor) -> str:
    """The motor of a joint, within its greatest effort if there is one."""
    limits = "" if most is None else f' ctrllimited="true" ctrlrange="{-most:g} {most:g}"'
    return f"    <motor name={quoteattr(unused(f'{joint}_motor', vendor.names))} joint={quoteattr(joint)}{limits}/>"


def ball_text(radius: float, mass: float) -> str:
    """MJCF of a ball that floats."""
    return f"""<mujoco model="ball">
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="ball">
      <freejoint name="free"/>
      <geom name="ball" type="sphere" size="{radius:g}" mass="{mass:g}"/>
    </body>
  </worldbody>
</mujoco>
"""


def scenario_text(
    name: str, robot: str, strip: Sequence[str], decompose: Sequence[Mapping[str, Any]], start: Start, places: Places
) -> str:
    """The scenario, commented.

    Args:
        name: Its name.
        robot: Name of the robot's file, for people.
        strip: Elements removed from the robot.
        decompose: Meshes that become convex pieces.
        start: Pose, tip and ball at the start.
        places: Where the robot's files are.
    """
    what = f"A ball hits the tip of {robot} after one second." if start.approach else f"{robot} floats."
    lines = [
        f"# {what} Edit this file freely:",
        f"# 'ffsm check {name}.yaml' validates it; the user guide describes every key.",
        f"name: {write_flow(name)}",
        "duration_s: 4.0",
        "time_step_s: 0.001",
        "accuracy: 1e-9 # steps that are too long for this accuracy are divided",
        "control_period_s: 0.005",
        "",
        "robot:",
        f"  mjcf: {write_flow(places.model)}",
        *_robot_lines(strip, decompose, start, places),
        *_initial_lines(name, start),
        "",
        "# The report states the distance of the tip from this point, its initial position.",
        f"task: {{tip: {write_flow(start.tip)}, target_m: {flow(start.target)}}}",
        *_CONTACTS[start.approach is not None],
        *_phase_lines(start),
    ]
    return "\n".join(lines) + "\n"


_CONTACTS = {
    True: (
        "",
        "# restitution: 1 conserves the energy, 0 gives the largest loss.",
        "# Every geom of the robot may touch the ball. Contacts of the robot with itself are ignored.",
        "contacts:",
        "  default: {restitution: 0.8}",
        "  ignored:",
        "    - {between: [robot, self], reason: links overlap at their joints}",
    ),
    False: (
        "",
        "contacts:",
        "  ignored:",
        "    - {between: [robot, self], reason: links overlap at their joints}",
    ),
}
"""With a ball and without."""


def _initial_lines(name: str, start: Start) -> list[str]:
    """Objects and the initial state."""
    joints = [f"    {write_flow(joint)}: {value:.10g}" for joint, value in start.pose.items()]
    if start.approach is None:
        return ["", "initial:", "  joints: # rad or m", *joints] if joints else []
    return [
        "objects:",
        f"  ball: {{mjcf: {name}_ball.xml}}",
        "",
        "initial:",
        "  joints: # rad or m; the ball: x, y, z in m and a quaternion w, x, y, z",
        *joints,
        f"    ball/free: {flow([*start.approach.place, 1, 0, 0, 0])}",
        "  rates: # the ball: m/s in world axes, rad/s in its own",
        f"    ball/free: {flow([*start.approach.velocity, 0, 0, 0])}",
    ]


def _phase_lines(start: Start) -> list[str]:
    """Phases: the joints are held, left alone after the impact for a while, and held again; coasting without motors."""
    if not start.kp:
        said = "Servos keep the pose of the start; motors are off." if start.servos else "No joint is driven."
        return ["", "phases:", f"  # {said}", '  - {name: coast, until: end, controller: {kind: "off"}}']
    return [
        "",
        "phases:",
        "  # Each joint is held at its initial position, critically damped for the inertia that it moves.",
        "  - name: wait",
        "    until: impact" if start.approach else "    for_s: 1.0",
        "    controller: &hold",
        "      kind: pd",
        f"      kp: {flow(start.kp)} # N m/rad, N/m",
        f"      kd: {flow(start.kd)} # N m s/rad, N s/m",
        "  # Then the motors are off for a while, as after the impact in the paper.",
        "  - name: pause",
        "    for_s: 0.5",
        '    controller: {kind: "off"}',
        "  - name: hold",
        "    until: end",
        "    controller: *hold",
    ]


def _robot_lines(strip: Sequence[str], decompose: Sequence[Mapping[str, Any]], start: Start, places: Places) -> list[str]:
    lines = []
    if places.folders:
        lines += ["  # Folders of the vendor's files; no others are read.", f"  asset_folders: {flow(places.folders)}"]
    if places.packages:
        lines.append(f"  package_paths: {flow(places.packages)}")
    if strip:
        lines += [
            "  # Removed before compilation: these elements are not modelled.",
            f"  strip: {flow(strip)}",
        ]
    if decompose:
        lines += [
            "  # Meshes that are not convex, as convex pieces: what touches would be their hulls.",
            f"  decompose: {flow_maps(decompose)}",
        ]
    if start.on:
        body, place = start.on
        lines += [
            "  # A site at the end of the arm, where the vendor's file has none: its body, and its position in it in m.",
            f"  sites: {{{write_flow(start.tip)}: {{body: {write_flow(body)}, pos_m: {flow(place)}}}}}",
        ]
    return lines


def flow(values: Sequence[float | str]) -> str:
    """Numbers, with seven digits, or texts as a list in YAML."""
    return write_flow([value if isinstance(value, str) else _number(value) for value in values])


def flow_maps(maps: Sequence[Mapping[str, Any]]) -> str:
    """Mappings of plain values as a list in YAML, with braces around each."""
    texts = (", ".join(f"{key}: {write_flow(value)}" for key, value in one.items()) for one in maps)
    return f"[{', '.join(f'{{{text}}}' for text in texts)}]"


def _number(value: float) -> float | int:
    short = float(f"{value:.7g}")
    return int(short) if short.is_integer() else short
