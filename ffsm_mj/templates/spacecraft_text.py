"""The files of a spacecraft of one's own as text, every line with a comment: the bus, a target, and the mission."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from ffsm_mj.model.source import unused
from ffsm_mj.templates.layout import Jet
from ffsm_mj.templates.mission import APPROACH_S, DETUMBLE_S, DURATION_S, MOVING_S, STAND_OFF_S
from ffsm_mj.templates.robot_text import Base, Places, flow, motor_text, rounded
from ffsm_mj.templates.vendor import Vendor
from ffsm_mj.yaml import write_flow

_COLUMN, _WIDEST = 44, 124
"""Where comments begin, and lines that are longer have theirs above them."""
_LOOK = 'mass="0" contype="0" conaffinity="0" group="1" rgba="0.13 0.22 0.45 1"'
_USUAL_WAY_M = 0.15
"""Of an arm with a reach of 1 m, from the tool to the grapple while it waits."""

Row = tuple[str, str]
"""A line, and its comment."""


@dataclass(frozen=True)
class Craft:
    """A bus with its actuators.

    Attributes:
        base: The bus without its wheels.
        axes: Spin axis of each wheel.
        wheel: Name of the joint and motor of each.
        wheel_mass: Of a wheel, kg.
        spin: Moment of inertia of a wheel about its axis, kg m^2.
        most_torque: Of a wheel, N m.
        most_speed: Of a wheel, rad/s.
        jets: The thrusters.
        jet: Name of the site and actuator of each.
        force: Of a thruster, N.
        bus: Name of the body.
        free: Name of its joint.
        unit: Name of the site of the sensors.
    """

    base: Base
    axes: Sequence[tuple[float, ...]]
    wheel: Sequence[str]
    wheel_mass: float
    spin: float
    most_torque: float
    most_speed: float
    jets: Sequence[Jet]
    jet: Sequence[str]
    force: float
    bus: str
    free: str
    unit: str


@dataclass(frozen=True)
class Mission:
    """What the scenario says of arm and target.

    Attributes:
        joints: Driven joints of the arm.
        servos: Actuators of the vendor's that become motors.
        fingers: Other joints with motors, which are held.
        pose: Coordinates of all joints at the start.
        tool: Site of the tool: its name, body, place in m and quaternion.
        target: Paths of the target.
        target_strip: Elements removed from it.
        free: Joint that the target floats on.
        grapple: Site at which it is held: its name, body, place in m and quaternion.
        start: Pose of bus and of target, and rates of the target.
        way: From the tool to the grapple while the arm waits, m.
        turns: Whether the arm turns its tool every way.
        damping: Of motions of the arm that the tool does not feel, N m s/rad.
        kp: Gain of the position of the bus, N/m.
        kd: Of its velocity, N s/m.
        turn_kp: Of its attitude, N m/rad.
        turn_kd: Of its angular velocity, N m s/rad.
    """

    joints: Sequence[str]
    servos: Sequence[str]
    fingers: Sequence[str]
    pose: dict[str, float]
    tool: tuple[str, str, list[float], list[float]]
    target: Places
    target_strip: Sequence[str]
    free: str
    grapple: tuple[str, str, list[float], list[float]]
    start: tuple[list[float], list[float], list[float]]
    way: float
    turns: bool
    damping: float
    kp: float
    kd: float
    turn_kp: float
    turn_kd: float


def spacecraft_text(name: str, vendor: Vendor, craft: Craft, file: str) -> str:
    """MJCF of the spacecraft: bus, wheels and thrusters, with the vendor's file attached."""
    half, inertia = (" ".join(f"{value:g}" for value in values) for values in (craft.base.halves, craft.base.inertia))
    hull = unused(f"{craft.bus}_hull", vendor.names)
    top, body = craft.base.halves[2], f" body={quoteattr(vendor.root)}" if vendor.root else ""
    rows: list[Row] = [
        (f"<mujoco model={quoteattr(name)}>", "a spacecraft with an arm; angles in degrees"),
        ('  <option gravity="0 0 0"/>', "in space"),
        ("  <asset>", "what the file below needs"),
        (f'    <model name="vendor" file={quoteattr(file)}/>', "the arm's file, as its maker wrote it"),
        ("  </asset>", ""),
        ("  <worldbody>", "bodies"),
        (f'    <body name="{craft.bus}">', "the bus; its frame is at its centre"),
        (f'      <freejoint name="{craft.free}"/>', "it floats"),
        (
            f'      <inertial pos="0 0 0" mass="{craft.base.mass:g}" diaginertia="{inertia}"/>',
            "kg, kg m^2, without the wheels",
        ),
        (f'      <geom name="{hull}" type="box" size="{half}" mass="0" rgba="0.7 0.72 0.75 1"/>', "half its edges, m"),
        (f'      <site name="{craft.unit}"/>', "star tracker and gyro"),
        *(row for i in range(len(craft.jets)) for row in _jet_site(craft, i)),
        *(row for i in range(len(craft.axes)) for row in _wheel_body(craft, i)),
        (f'      <frame pos="0 0 {top:g}">', "the arm stands on the upper face"),
        (f'        <attach model="vendor"{body} prefix=""/>', "its root body, with all below it"),
        ("      </frame>", ""),
        ("    </body>", ""),
        ("  </worldbody>", ""),
        ("  <actuator>", "what drives all this; limits are in the scenario"),
        *(row for i in range(len(craft.jets)) for row in _jet_motor(craft, i)),
        *((f'    <motor name="{wheel}" joint="{wheel}"/>', "motor of the wheel") for wheel in craft.wheel),
        *((motor_text(joint, most, vendor), "motor of the arm") for joint, most in vendor.motors.items()),
        ("  </actuator>", ""),
        ("</mujoco>", ""),
    ]
    return _lines(rows, "<!-- ", " -->")


def _jet_site(craft: Craft, i: int) -> Iterable[Row]:
    place = [share * half for share, half in zip(craft.jets[i].place, craft.base.halves, strict=True)]
    return [(f'      <site name="{craft.jet[i]}" pos="{_triple(place)}"/>', "place of a thruster, m")]


def _jet_motor(craft: Craft, i: int) -> Iterable[Row]:
    push = _triple(craft.jets[i].push)
    gear = f'gear="{push} 0 0 0" ctrlrange="0 {craft.force:g}"'
    return [(f'    <motor name="{craft.jet[i]}" site="{craft.jet[i]}" {gear}/>', f"pushes the bus along {push}, N")]


def _wheel_body(craft: Craft, i: int) -> Iterable[Row]:
    axis, across, half = craft.axes[i], 0.55 * craft.spin, craft.base.halves
    moments = f"{across:g} {across:g} {craft.spin:g}"
    # Beside each other inside the bus: the axis of each leads through its middle.
    place = [0.4 * part * edge for part, edge in zip(axis, half, strict=True)]
    return [
        (f'      <body name="{craft.wheel[i]}" pos="{_triple(place)}" zaxis="{_triple(axis)}">', "a reaction wheel"),
        (f'        <joint name="{craft.wheel[i]}" axis="0 0 1"/>', "it spins about the z axis of its body"),
        (f'        <inertial pos="0 0 0" mass="{craft.wheel_mass:g}" diaginertia="{moments}"/>', "balanced"),
        ("      </body>", ""),
    ]


def _triple(values: Iterable[float]) -> str:
    return " ".join(f"{round(value, 6) + 0.0:.9g}" for value in values)


def target_text(edge: float, mass: float, mesh: str) -> str:
    """MJCF of a target that floats: a cuboid with solar panels, or the hull of a mesh."""
    half = edge / 2
    if mesh:
        shape, panels = 'type="mesh" mesh="hull"', list[Row]()
        needs = [
            ("  <asset>", "its shape"),
            (f'    <mesh name="hull" file={quoteattr(mesh)}/>', 'in m; scale="0.001 0.001 0.001" for mm'),
            ("  </asset>", ""),
        ]
    else:
        shape = f'type="box" size="{_triple([half] * 3)}"'
        needs = [
            ('  <default><default class="look">', "what is only looked at"),
            (f"    <geom {_LOOK}/>", "no mass, no contact"),
            ("  </default></default>", "a class of geoms"),
        ]
        panel = f'class="look" type="box" size="{_triple([0.6 * half, 1.2 * half, 0.02 * half])}"'
        panels = [
            (f'      <geom name="panel_{side}" pos="0 {y:g} 0" {panel}/>', "a solar panel")
            for side, y in (("left", 2.3 * half), ("right", -2.3 * half))
        ]
    rows: list[Row] = [
        ('<mujoco model="target">', "the target"),
        ('  <option gravity="0 0 0"/>', "in space"),
        *needs,
        ("  <worldbody>", "bodies"),
        ('    <body name="target">', "the only one"),
        ('      <freejoint name="free"/>', "it floats"),
        (f'      <geom name="hull" {shape} mass="{mass:g}" rgba="0.75 0.72 0.6 1"/>', "kg, of uniform density"),
        *panels,
        ("    </body>", ""),
        ("  </worldbody>", ""),
        ("</mujoco>", ""),
    ]
    return _lines(rows, "<!-- ", " -->")


def mission_text(name: str, robot: str, strip: Sequence[str], craft: Craft, mission: Mission, places: Places) -> str:
    """The scenario: what there is, how it begins, and the phases of the mission."""
    rows: list[Row] = [
        (f"name: {write_flow(name)}", "of runs and reports"),
        (f"duration_s: {DURATION_S:.1f}", "the run ends here"),
        ("time_step_s: 0.01", "step of the integrator"),
        ("accuracy: 1e-9", "steps that are too long for this accuracy are divided"),
        ("control_period_s: 0.02", "the laws of the phases decide this often"),
        ("", ""),
        *_model_rows(strip, mission, places),
        ("", ""),
        *_start_rows(craft, mission),
        ("", ""),
        *_actuator_rows(craft, mission),
        ("", ""),
        *_sensor_rows(craft, mission),
        ("", ""),
        *_grasp_rows(mission),
        ("", ""),
        *_phase_rows(craft, mission),
    ]
    head = [
        f"# {robot} on a bus with {len(craft.axes)} wheels and {len(craft.jets)} thrusters approaches a tumbling target,",
        f"# captures it, and brings both to rest. Edit this file freely: 'ffsm check {name}.yaml' validates it; the user",
        "# guide describes every key.",
    ]
    return "\n".join([*head, ""]) + _lines(rows, "# ", "")


def _model_rows(strip: Sequence[str], mission: Mission, places: Places) -> list[Row]:
    tool, body, place, turn = mission.tool
    grapple, holder, at, turned = mission.grapple
    return [
        ("robot:", "the spacecraft"),
        (f"  mjcf: {write_flow(places.model)}", "bus, wheels and thrusters, with the arm attached"),
        *_file_rows("  ", places, strip),
        ("  sites:", "added to the robot"),
        (
            f"    {tool}: {{body: {write_flow(body)}, pos_m: {flow(place)}, quaternion: {flow(turn)}}}",
            "x axis out of the hand",
        ),
        ("objects:", "what else floats"),
        ("  target:", "what is captured"),
        (f"    mjcf: {write_flow(mission.target.model)}", "its file"),
        *_file_rows("    ", mission.target, mission.target_strip),
        ("    sites:", "added to the target"),
        (
            f"      {grapple}: {{body: {write_flow(holder)}, pos_m: {flow(at)}, quaternion: {flow(turned)}}}",
            "x axis into the target",
        ),
        ("contacts:", "which geoms may touch"),
        ("  default: {restitution: 0.3}", "all of different models; 1 conserves the energy, 0 loses most"),
        ("  weld_m: 1.0e-8", "what meets within this on one body has one plane: meshes are in single precision, m"),
        ("  ignored:", "neither resolved nor reported"),
        ("    - {between: [robot, self], reason: links overlap at their joints}", "of the arm with itself and the bus"),
    ]


def _file_rows(indent: str, places: Places, strip: Sequence[str]) -> list[Row]:
    keys = (
        ("asset_folders", places.folders, "folders of its files; no others are read"),
        ("package_paths", places.packages, "packages that a URDF names"),
        ("strip", strip, "removed before compilation; docs/own-spacecraft.md says why"),
    )
    return [(f"{indent}{key}: {flow(values)}", comment) for key, values, comment in keys if values]


def _start_rows(craft: Craft, mission: Mission) -> list[Row]:
    bus, target, rates = mission.start
    return [
        ("initial:", "state at the start"),
        ("  joints:", "rad or m; of what floats x, y, z in m and a quaternion w, x, y, z"),
        (f"    {craft.free}: {flow(bus)}", "the bus: the world frame is where it is at the capture"),
        *(
            (f"    {write_flow(joint)}: {value:.7g}", "the arm waits behind the grapple")
            for joint, value in mission.pose.items()
        ),
        (f"    {write_flow(mission.free)}: {flow(target)}", "so that the target is in reach when the bus has arrived"),
        ("  rates:", "what is left out is at rest"),
        (f"    {write_flow(mission.free)}: {flow(rates)}", "m/s in world axes, rad/s in its own: it tumbles"),
    ]


def _actuator_rows(craft: Craft, mission: Mission) -> list[Row]:
    wheel = f"{{kind: reaction_wheel, max_torque_N_m: {craft.most_torque:g}, max_speed_rad_s: {craft.most_speed:g}}}"
    jet = f"{{kind: on_off, force_N: {craft.force:g}, threshold_N: {craft.force / 2:g}}}"
    stored = rounded(craft.spin * craft.most_speed, 3)
    return [
        ("actuators:", "limits"),
        (f"  {craft.wheel[0]}: &wheel {wheel}", f"stores {stored:g} N m s"),
        *((f"  {one}: *wheel", "the same") for one in craft.wheel[1:]),
        (f"  {craft.jet[0]}: &jet {jet}", "off, or on with this force, where more than the threshold is asked"),
        *((f"  {one}: *jet", "the same") for one in craft.jet[1:]),
        *(
            (f"  {write_flow(one)}: {{kind: torque}}", "the maker's servo as a motor within its forcerange")
            for one in mission.servos
        ),
    ]


def _sensor_rows(craft: Craft, mission: Mission) -> list[Row]:
    camera = f"of: target/{mission.grapple[0]}, relative_to: {mission.tool[0]}, interval_s: 0.1, delay_s: 0.1"
    return [
        (
            "# estimator: {kind: mekf, gyro_bias_rad_s: 1.0e-5}",
            "without the first '# ' laws know the state from the sensors",
        ),
        ("sensors:", "measured and logged"),
        (
            f"  star_tracker: {{kind: framequat, of: {craft.unit}, interval_s: 0.2, noise: 5.0e-5}}",
            "attitude of the bus, rad",
        ),
        (f"  gyro: {{kind: gyro, of: {craft.unit}, interval_s: 0.02, noise: 1.0e-5}}", "its angular velocity, rad/s"),
        (f"  navigation: {{kind: framepos, of: {craft.bus}, interval_s: 1.0, noise: 0.005}}", "its position, m"),
        (f"  camera_position: {{kind: framepos, {camera}, noise: 0.003}}", "of the grapple as the hand sees it, m"),
        (f"  camera_attitude: {{kind: framequat, {camera}, noise: 0.005}}", "rad"),
        *(
            (
                f"  {write_flow(f'encoder_{i}')}: {{kind: jointpos, of: {write_flow(joint)}, quantum: 1.0e-4}}",
                "of the arm, rad",
            )
            for i, joint in enumerate(mission.joints, 1)
        ),
        *(
            (f"  {write_flow(f'tachometer_{i}')}: {{kind: jointvel, of: {wheel}, quantum: 0.01}}", "of a wheel, rad/s")
            for i, wheel in enumerate(craft.wheel, 1)
        ),
    ]


def _grasp_rows(mission: Mission) -> list[Row]:
    angles = ", angle_rad: 0.03, rate_rad_s: 0.01" if mission.turns else ""
    return [
        ("grasps:", "what the hand may hold"),
        ("  grasp:", "the only one; it closes while a phase arms it"),
        (f"    robot_site: {mission.tool[0]}", "on the hand"),
        (f"    object_site: target/{mission.grapple[0]}", "on the target"),
        (f"    when: {{within: {{position_m: 0.005, speed_m_s: 0.005{angles}}}}}", "it closes where all of this holds"),
        ("    load_limit: {force_N: 100.0, torque_N_m: 50.0}", "it opens above this load; 'detumble' keeps to half of it"),
    ]


def _phase_rows(craft: Craft, mission: Mission) -> list[Row]:
    joints = flow(mission.fingers)
    fingers = [(f"      fingers: &fingers {{kind: hold, joints: {joints}, bandwidth_rad_s: 2.0}}", "they keep their pose")]
    again = [("      fingers: *fingers", "they keep their pose")]
    if not mission.fingers:
        fingers = again = []
    return [
        ("phases:", "one after the other"),
        *_approach_rows(craft, mission),
        *fingers,
        *_follow_rows(mission),
        *again,
        ("  - name: close_in", "the hand moves to the grapple"),
        ("    until: grasp", "then the next phase begins"),
        ("    arm: [grasp]", "the grasp may close"),
        ("    controllers:", "a law for each part"),
        ("      arm: {<<: *follow, offset_m: [0, 0, 0]}", "as before, without a distance"),
        *again,
        *_rest_rows(mission),
        *again,
        ("", ""),
        ("terminal: {stack_momentum_N_m_s: 0.01}", "a check of the run: less is left at its end, without the wheels"),
    ]


def _approach_rows(craft: Craft, mission: Mission) -> list[Row]:
    there = f"waypoints: [{{at_s: {MOVING_S:g}, position_m: [0, 0, 0]}}]"
    still = f"arm: &still {{kind: hold, joints: &arm {flow(mission.joints)}, bandwidth_rad_s: 2.0}}"
    return [
        ("  - name: approach", "the bus comes to the target, the arm waits"),
        (f"    for_s: {APPROACH_S:.1f}", "then the next phase begins"),
        ("    controllers:", "a law for each part"),
        ("      base:", "the bus"),
        ("        kind: base_pd", "PD control of position and attitude, allocated to thrusters and wheels"),
        (f"        thrusters: &jets {flow(craft.jet)}", "they push"),
        (f"        wheels: &wheels {flow(craft.wheel)}", "they turn"),
        (
            f"        translation: {{kp: {mission.kp:g}, kd: {mission.kd:g}, {there}}}",
            "N/m, N s/m: to the origin in this time, smoothly",
        ),
        (
            f"        rotation: {{kp: {mission.turn_kp:g}, kd: {mission.turn_kd:g}}}",
            "N m/rad, N m s/rad: it keeps its attitude",
        ),
        (f"      {still}", "it keeps its pose"),
    ]


def _follow_rows(mission: Mission) -> list[Row]:
    most = rounded(0.06 * min(1.0, mission.way / _USUAL_WAY_M), 2)
    turning = f"rotation: {{kp_N_m_rad: {mission.turn_kp:g}, kd_N_m_s_rad: {mission.turn_kd:g}}}"
    attitude = (
        [("        attitude: {kp_1_s2: 0.36, kd_1_s: 1.2, max_rate_rad_s: 0.12}", "likewise")] if mission.turns else []
    )
    return [
        ("  - name: stand_off", "the hand follows the grapple from a distance"),
        (f"    for_s: {STAND_OFF_S:.1f}", "long enough to be at rest against it"),
        ("    controllers:", "a law for each part"),
        ("      arm: &follow", "hand and bus, by one law"),
        ("        kind: track", "computed torque on the tool"),
        (f"        robot_site: {mission.tool[0]}", "what follows"),
        (f"        object_site: target/{mission.grapple[0]}", "what it follows"),
        ("        joints: *arm", "that move it"),
        (f"        offset_m: [{-mission.way:.3g}, 0, 0]", "behind the grapple, in its frame, m"),
        (f"        position: {{kp_1_s2: 0.36, kd_1_s: 1.2, max_speed_m_s: {most:g}}}", "critical damping"),
        *attitude,
        (f"        joint_damping_N_m_s_rad: {mission.damping:g}", "of motions that the tool does not feel"),
        (
            f"        base: {{thrusters: *jets, wheels: *wheels, {turning}}}",
            "wheels keep the attitude; no thruster fires, as no gains of translation are given",
        ),
    ]


def _rest_rows(mission: Mission) -> list[Row]:
    return [
        ("  - name: detumble", "wheels take the angular momentum of both bodies"),
        ("    until: finished", "when that of bus and target is below the tolerance"),
        (f"    for_s: {DETUMBLE_S:.1f}", "or after this time"),
        ("    controller:", "one law for all"),
        ("      kind: detumble", "of what the grasp holds together"),
        ("      wheels: *wheels", "they take the momentum"),
        ("      thrusters: *jets", "they take what full wheels cannot"),
        ("      rate_1_s: 0.4", "it falls by this share per second where no limit is reached"),
        (
            f"      arm: {{joints: {flow([*mission.joints, *mission.fingers])}, bandwidth_rad_s: 0.8}}",
            "it keeps its pose, softly",
        ),
        ("      tolerance_N_m_s: 1.0e-3", "of the end of this phase"),
        ("  - name: rest", "thrusters stop the drift of both, wheels and arm hold"),
        ("    until: end", "of the run"),
        ("    controllers:", "a law for each part"),
        ("      base:", "the bus with what it holds"),
        ("        kind: base_pd", "as in the approach"),
        ("        thrusters: *jets", "they push"),
        ("        wheels: *wheels", "they turn"),
        (f"        translation: {{kp: 0, kd: {mission.kd:g}}}", "to rest, wherever that is"),
        (f"        rotation: {{kp: {mission.turn_kp:g}, kd: {mission.turn_kd:g}}}", "it keeps its attitude"),
        ("      arm: *still", "it keeps its pose"),
    ]


def _lines(rows: Iterable[Row], mark: str, end: str) -> str:
    """Lines with their comments beside them, or above where a line is long."""
    lines = []
    for text, comment in rows:
        indent = text[: len(text) - len(text.lstrip())]
        if not comment:
            lines.append(text)
        elif len(line := f"{text:<{_COLUMN}} {mark}{comment}{end}") <= _WIDEST:
            lines.append(line)
        else:
            lines += [f"{indent}{mark}{comment}{end}", text]
    return "\n".join(lines) + "\n"
