"""Public robots as their makers wrote them, meshes aside: ``python -m tests.robots.menagerie [ROBOT ...]`` prints a table.

The files are those of MuJoCo Menagerie, a folder a robot, without meshes and textures. Each geom that shows a mesh becomes a
sphere of 20 mm with its name, class, contype, mass and density; textures go. A robot that does not float stands on a bus of
500 kg. A ball is thrown at its outermost geom that can be hit.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from ffsm_mj.model.system import System
from ffsm_mj.replay import replay_log
from tests.scenes import HEAD

FOLDER = Path(os.environ.get("FFSM_MENAGERIE", Path(__file__).parents[3] / "shared" / "menagerie"))
"""Folder of the robots: of the environment variable, or beside the checkout, where it may be absent."""

_MAIN_FILES = """
agilex_piper/piper agility_cassie/cassie aloha/aloha anybotics_anymal_b/anymal_b anybotics_anymal_c/anymal_c
apptronik_apollo/apptronik_apollo arx_l5/arx_l5 berkeley_humanoid/berkeley_humanoid bitcraze_crazyflie_2/cf2
booster_t1/t1 boston_dynamics_spot/spot_arm dynamixel_2r/dynamixel_2r flybody/fruitfly fourier_n1/n1
franka_emika_panda/panda franka_fr3/fr3 franka_fr3_v2/fr3v2 google_barkour_v0/barkour_v0 google_barkour_vb/barkour_vb
google_robot/robot hello_robot_stretch/stretch hello_robot_stretch_3/stretch honi_robot/honi_scene_v2.1 i2rt_yam/yam
iit_softfoot/softfoot kinova_gen3/gen3 kuka_iiwa_14/iiwa14 leap_hand/right_hand low_cost_robot_arm/low_cost_robot_arm
pal_talos/talos_position pal_tiago/tiago_position pal_tiago_dual/tiago_dual_position pndbotics_adam_lite/adam_lite
rethink_robotics_sawyer/sawyer robot_soccer_kit/robot_soccer_kit robotiq_2f85/2f85 robotiq_2f85_v4/2f85
robotis_op3/op3 robotstudio_so101/so101 shadow_dexee/shadow_dexee shadow_hand/right_hand skydio_x2/x2
stanford_tidybot/tidybot tetheria_aero_hand_open/right_hand toddlerbot_2xc/toddlerbot_2xc
toddlerbot_2xm/toddlerbot_2xm trossen_vx300s/vx300s trossen_wx250s/wx250s trossen_wxai/trossen_ai_bimanual
trs_so_arm100/so_arm100 ufactory_lite6/lite6 ufactory_xarm7/xarm7 umi_gripper/umi_gripper unitree_a1/a1
unitree_g1/g1_with_hands unitree_go1/go1 unitree_go2/go2 unitree_h1/h1 unitree_z1/z1_gripper
universal_robots_ur10e/ur10e universal_robots_ur5e/ur5e wonik_allegro/right_hand
"""
FILES = {folder: file for folder, _, file in (path.partition("/") for path in _MAIN_FILES.split())}
"""The main file of each folder; ``realsense_d435i``, a camera without joints, is no robot."""

_OF_OTHERS = ("honi_robot",)
"""Robots that include files of other folders."""
STRIPS = ("servos", "frictionloss", "equalities", "tendons", "limits", "damping", "stiffness", "gravcomp", "sensors")
BUS_KG = 500.0
DURATION_S = 2.0
_SPHERE_M = 0.02
_SPEED = 0.5  # extents of the robot per second
_CLEAR = 0.01  # extents: the ball meets the robot where it stands
_RADIUS = 0.03  # extents
_CLOSE_M = 1e-6  # extents
_ALL_BITS = 2**31 - 1


@dataclass
class Result:
    """What became of a robot.

    Attributes:
        robot: Name of its folder.
        refused: Lines of the refusal of the file as it is; empty if it is not refused.
        stripped: What ``strip`` took out so that it runs; nothing if it is not refused.
        outcome: Outcome of the run, or the first line of a refusal.
        hits: Impacts of the ball with the robot.
        failing: Checks that fail, with values.
        replayed: Whether log and replay agree.
        replay: Why they do not.
        seconds: Wall time of the run.
    """

    robot: str
    refused: tuple[str, ...] = ()
    stripped: tuple[str, ...] = ()
    outcome: str = ""
    hits: int = 0
    failing: list[str] = field(default_factory=list)
    replayed: bool = False
    replay: str = ""
    seconds: float = 0.0

    @property
    def passes(self) -> bool:
        """Whether the unmodified robot ran to the end, was hit, and its checks and its replay agree."""
        return not self.refused and self.completes

    @property
    def completes(self) -> bool:
        """Whether it did so, stripped or not."""
        return self.outcome == "completed" and self.hits > 0 and not self.failing and self.replayed


def write_robot(robot: str, folder: Path) -> Path:
    """Write a robot with spheres for meshes to a folder, on a bus if it does not float; returns its main file."""
    for path in sorted(FOLDER.rglob("*.xml") if robot in _OF_OTHERS else (FOLDER / robot).rglob("*.xml")):
        target = folder / path.relative_to(FOLDER)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(without_meshes(path.read_bytes()))
    main = folder / robot / f"{FILES[robot]}.xml"
    spec = mujoco.MjSpec.from_file(str(main))
    if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for body in spec.worldbody.bodies for joint in body.joints):
        return main
    return on_a_bus(main)


def on_a_bus(main: Path) -> Path:
    """A bus of 500 kg in a file of its own, on which a robot of another file beside it stands."""
    bus = main.parent / "on_a_bus.xml"
    bus.write_text(f"""<mujoco model="bus">{HEAD}<asset><model name="robot" file="{main.name}"/></asset>
      <worldbody><body name="bus"><freejoint name="bus"/><geom name="bus" type="box" size="0.4 0.4 0.4" mass="{BUS_KG}"/>
        <frame pos="0 0 0.4"><attach model="robot" prefix=""/></frame></body></worldbody></mujoco>""")
    return bus


def without_meshes(xml: bytes) -> bytes:
    """An MJCF file with spheres for meshes and without textures and skins."""
    root = ElementTree.fromstring(xml)
    for parent in list(root.iter()):
        for child in list(parent):
            if parent.tag == "asset" and child.tag in ("mesh", "texture", "skin"):
                parent.remove(child)
            elif child.tag == "material":
                child.attrib.pop("texture", None)
                child[:] = []
            elif child.tag == "skin":
                parent.remove(child)
            elif child.tag == "geom" and ("mesh" in child.attrib or child.get("type") == "mesh"):
                child.attrib.pop("mesh", None)
                child.attrib |= {"type": "sphere", "size": str(_SPHERE_M)}
    return ElementTree.tostring(root)


Write = Callable[[str, Path], Path]
"""Writes a robot by its name to a folder; returns its main file, in a folder of its own below."""


def tried(robot: str, limit_s: float = 120.0, *, write: Write = write_robot, strip: bool = False) -> Result:
    """Throw a ball at a robot.

    Args:
        robot: Its name.
        limit_s: Wall time after which it has failed.
        write: Writes it.
        strip: Whether a robot that is refused is tried again without what is not modelled.
    """
    result = Result(robot)
    signal.signal(signal.SIGALRM, partial(_too_long, f"{limit_s:g} s"))
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    with tempfile.TemporaryDirectory() as folder:
        try:
            _try(write(robot, Path(folder)), result, strip=strip)
        except Exception as error:  # noqa: BLE001 (a row of the table)
            result.outcome = f"{type(error).__name__}: {str(error).splitlines()[0]}"
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    return result


def _too_long(limit: str, *_: object) -> None:
    raise TimeoutError(f"not done after {limit}")


def _try(main: Path, result: Result, *, strip: bool) -> None:
    result.refused = _refusal(main, ())
    if result.refused and (impossible := _refusal(main, STRIPS) if strip else result.refused):
        result.outcome = impossible[0]
        return
    if result.refused:
        needed = list(STRIPS)
        for word in reversed(STRIPS):  # one word may be what another one needs
            less = [each for each in needed if each != word]
            needed = needed if _refusal(main, less) else less
        result.stripped = tuple(needed)
    start = time.perf_counter()
    run = ffsm_mj.run(write_throw(main, result.stripped))
    result.seconds = time.perf_counter() - start
    result.outcome = run.outcome if run.outcome == "completed" else f"{run.outcome}: {run.message}"
    result.hits = sum("ball/ball" in impact.geoms for impact in run.impacts)
    result.failing = [f"{check.name} {check.residual:.1e}" for check in all_checks(run) if not check.passes]
    result.failing += [f"unhandled contact {' and '.join(each.geoms)}" for each in run.unhandled_contacts[:1]]
    again = replay_log(run.log)
    result.replayed = again.agrees
    if not again.agrees:
        differing = [f"{name} by {worst}" for name, worst in again.worst.items() if not worst.passes]
        result.replay = again.obstacle or "; ".join(differing)


def _refusal(main: Path, strip: Iterable[str]) -> tuple[str, ...]:
    """Lines of the refusal of a robot far from its ball; empty if there is none."""
    try:
        system = _compiled(main, strip)
        initial = {"joints": {**_pose(system), "ball/ball": [0, 0, 99, 1, 0, 0, 0]}}
        prepare(_written(main, strip, initial, mass=1.0, radius=0.05))
    except InputError as error:
        return tuple(line.replace(f"{main.parent}/", "") for line in error.lines)
    return ()


def _compiled(main: Path, strip: Iterable[str]) -> System:
    """Robot and ball.

    Raises:
        InputError: The robot is refused.
    """
    _write_ball(main.parent, 1.0, 0.05)
    robot, ball = read_model(main, [main.parents[1]]), read_model(main.parent / "ball.xml")
    return compile_system(replace(robot, strip=tuple(strip)), {"ball": ball}, time_step_s=0.001)


def write_throw(main: Path, strip: Iterable[str] = ()) -> Path:
    """The scenario of a throw: at the pose of the first keyframe, or else of the file.

    Raises:
        InputError: The robot is refused.
        LookupError: No geom can be hit.
    """
    system = _compiled(main, strip)
    model, data = system.mj, mujoco.MjData(system.mj)
    pose = _pose(system)
    for name, value in pose.items():
        data.qpos[system.joint(name).qpos] = value
    mujoco.mj_forward(model, data)
    bodies = np.array(system.robot.bodies)
    mass = float(model.body_mass[bodies[model.body(bodies[0]).name == "robot/bus" :]].sum())
    geoms = np.flatnonzero(np.isin(model.geom_bodyid, bodies))
    centre = data.subtree_com[system.robot.root]
    extent = float(max(np.linalg.norm(data.geom_xpos[geoms] - centre, axis=1) + model.geom_rbound[geoms]))
    for scale in (1.0, 0.3):  # a smaller ball reaches what other geoms surround
        radius = scale * _RADIUS * extent
        if (way := _way(system, data, centre, extent, radius)) is not None:
            place, direction = way
            start = {
                "joints": {**pose, "ball/ball": [*(place + _CLEAR * extent * direction).tolist(), 1, 0, 0, 0]},
                "rates": {"ball/ball": [*(-_SPEED * extent * direction).tolist(), 0, 0, 0]},
            }
            geoms = solid_geoms(system)
            by_pairs = not model.geom_contype[geoms].any() and not model.geom_conaffinity[geoms].any()
            paired = [model.geom(g).name for g in geoms] if by_pairs else []
            return _written(main, strip, start, mass=0.02 * mass, radius=radius, paired=paired)
    raise LookupError("no geom of the robot can be hit")


def _pose(system: System) -> dict[str, Any]:
    """Coordinates of the joints at the first keyframe; without one, of those that the file leaves past a limit.

    Joints that follow others are left to these: keyframes contradict the couplings of their files.
    """
    model, pose = system.mj, {}
    followers = model.eq_obj1id[(model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & (model.eq_obj2id >= 0) & model.eq_active0]
    follows = {model.joint(j).name for j in followers.tolist()}
    for joint in [each for each in system.robot.joints if each.name not in follows]:
        given = (model.key_qpos[0] if model.nkey else model.qpos0)[joint.qpos]
        j = model.joint(joint.name).id
        limited = model.jnt_limited[j] and joint.kind in ("hinge", "slide")
        value = np.clip(given, *model.jnt_range[j]) if limited else given  # a keyframe is rounded
        if model.nkey or not np.array_equal(value, given):
            pose[joint.name] = value.tolist()
    return pose


Way = tuple[NDArray[np.float64], NDArray[np.float64]]


def _way(system: System, data: Any, centre: NDArray[np.float64], extent: float, radius: float) -> Way | None:
    """Where a ball touches the outermost geom that a line from outside leads to, and the unit vector of that line."""
    model = copy(system.mj)
    geoms = solid_geoms(system)
    outermost = sorted(geoms, key=lambda g: -np.linalg.norm(data.geom_xpos[g] - centre) - model.geom_rbound[g])
    ball = int(model.geom("ball/ball").id)
    model.geom_size[ball, 0] = model.geom_rbound[ball] = radius
    for geom in outermost:
        aim = data.geom_xpos[geom].copy()
        for direction in _directions(aim - centre):
            left = 2.5 * extent
            while left > -radius:
                data.geom_xpos[ball] = aim + left * direction
                gap, first = min((mujoco.mj_geomDistance(model, data, ball, g, 9.0 * extent, None), g) for g in geoms)
                if gap < _CLOSE_M * extent:
                    if first == geom:
                        return aim + left * direction, direction
                    break
                left -= gap
    return None


def solid_geoms(system: System) -> list[int]:
    """Geoms of the robot that may touch something; all of them where the file leaves that to pairs."""
    model = system.mj
    robot = np.isin(model.geom_bodyid, system.robot.bodies)
    solid = robot & ((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    return np.flatnonzero(solid if solid.any() else robot).tolist()


def _directions(outwards: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Unit vectors from which a ball may come: outwards, then along the axes of the world and between them."""
    for way in (outwards, *sorted(product((-1.0, 0.0, 1.0), repeat=3), key=np.count_nonzero)):
        if (length := float(np.linalg.norm(way))) > 1e-6:
            yield np.asarray(way) / length


def _written(
    main: Path, strip: Iterable[str], initial: dict[str, Any], *, mass: float, radius: float, paired: Iterable[str] = ()
) -> Path:
    """Write the scenario beside the robot; geoms that touch by pairs alone are named in rules."""
    _write_ball(main.parent, mass, radius)
    scenario = {
        "name": "throw",
        "duration_s": DURATION_S,
        "time_step_s": 0.001,
        "control_period_s": 0.01,
        "accuracy": 1e-9,
        "robot": {"mjcf": main.name, "asset_folders": [".."], **({"strip": list(strip)} if strip else {})},
        "objects": {"ball": {"mjcf": "ball.xml"}},
        "initial": initial,
        "contacts": {
            "default": {"restitution": 0.5},
            **({"rules": [{"between": [geom, "ball/ball"]} for geom in paired]} if paired else {}),
            "ignored": [{"between": ["robot", "self"], "reason": "links overlap at their joints"}],
        },
        "phases": [{"name": "throw", "until": "end", "controller": {"kind": "off"}}],
    }
    path = main.parent / "throw.yaml"
    path.write_text(json.dumps(scenario))  # JSON is YAML
    return path


def _write_ball(folder: Path, mass: float, radius: float) -> None:
    """Write the ball, which may touch every geom that may touch anything."""
    (folder / "ball.xml").write_text(f"""<mujoco>{HEAD}<worldbody><body name="ball"><freejoint name="ball"/>
      <geom name="ball" size="{radius!r}" mass="{mass!r}" contype="{_ALL_BITS}" conaffinity="{_ALL_BITS}"/></body>
      </worldbody></mujoco>""")


def print_table(module: str, description: str | None, robots: Sequence[str], write: Write) -> int:
    """The command of a series of robots: a line for each, and how many pass."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="names; default: all")
    parser.add_argument("--jobs", type=int, default=1, help="processes; default 1")
    parser.add_argument("--time-out", type=float, default=120.0, metavar="S", help="wall time of a robot; default 120 s")
    options = parser.parse_args()
    results = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for result in pool.map(partial(tried, limit_s=options.time_out, write=write, strip=True), options.robots or robots):
            results.append(result)
            print(_row(result), flush=True)
    stripped = sum(result.completes for result in results)
    print(f"{sum(result.passes for result in results)} of {len(results)} robots pass unmodified, {stripped} also stripped")
    return 0


def _row(result: Result) -> str:
    """A line of the table, and a line with the first reason of a refusal."""
    verdict = "passes" if result.passes else "stripped" if result.completes else "FAILS"
    parts = [
        f"{result.robot:24} {verdict:8} {result.seconds:5.1f} s, {result.hits} hits, {result.outcome[:160]}",
        *([f"    failing: {', '.join(result.failing)}"] if result.failing else []),
        *([f"    replay and log differ: {result.replay[:160]}"] if result.replay else []),
        *([f"    strip: {', '.join(result.stripped)}"] if result.stripped else []),
        *([f"    refused, {len(result.refused)} times: {result.refused[0][:160]}"] if result.refused else []),
    ]
    return "\n".join(parts)


if __name__ == "__main__":
    raise SystemExit(print_table("tests.robots.menagerie", __doc__, tuple(FILES), write_robot))
