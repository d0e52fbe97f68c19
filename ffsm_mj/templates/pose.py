"""Where a robot begins, its end, and the way on which a ball meets it there: all found in the compiled models."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.initial_state import fault_of_start
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.model.system import System, ancestors

_BEND = 0.3
"""A joint begins bent by this, rad, where its range has zero well inside: a straight arm hardly gives way."""
_CLOSE = 1e-6
_MOST_MARCHES = 100


@dataclass(frozen=True)
class Tip:
    """The end of a robot.

    Attributes:
        site: Name of a site that the file has; empty where it is to be added.
        body: Id of the body that it is on.
        local: Its place in the frame of that body, m, (3,).
    """

    site: str
    body: int
    local: FloatArray


@dataclass(frozen=True)
class Approach:
    """How a ball meets the robot at rest.

    Attributes:
        touch: Centre of the ball when it touches, m, (3,).
        outwards: Unit vector from there to where it comes from, (3,).
        body: Id of the body of the robot that it touches.
    """

    touch: FloatArray
    outwards: FloatArray
    body: int


def starting_pose(system: System) -> dict[str, float]:
    """Coordinate of each hinge and slide above the base, within its limits: of the first keyframe, or bent a little.

    Joints of a mechanism are where the file has them, if it has no keyframe: equality constraints bind them there.
    """
    model, base = system.mj, system.robot.base_dofs
    bound = _bound_joints(model)
    pose = {}
    for joint in system.robot.joints:
        if joint.kind in ("free", "ball") or (base.start <= joint.dofs.start < base.stop and _floats(system)):
            continue
        j = model.joint(joint.name).id
        low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.inf, np.inf)
        inside = low < -_BEND < _BEND < high
        if not model.nkey and joint.name in bound and low <= model.qpos0[joint.qpos.start] <= high:
            continue
        if model.nkey:
            value = float(model.key_qpos[0, joint.qpos.start])
        elif joint.kind == "hinge" and inside:
            value = _BEND
        else:
            value = 0.0 if inside or np.isinf(low) else float(low + high) / 2
        # A keyframe may be past a limit by rounding, and so is one that is rounded itself.
        digits = 4 if not bound else 12
        pose[joint.name.split("/", 1)[1]] = min(max(round(value, digits), float(low)), float(high))
    return pose


def _bound_joints(model: Any) -> set[str]:
    """Joints that equality constraints may bind: those that they name, or all of them where they close loops."""
    active = np.flatnonzero(model.eq_active0)
    if (model.eq_type[active] != int(mujoco.mjtEq.mjEQ_JOINT)).any():
        return {model.joint(j).name for j in range(model.njnt)}
    ends = {int(end) for end in (*model.eq_obj1id[active], *model.eq_obj2id[active]) if end >= 0}
    return {model.joint(j).name for j in ends}


def _floats(system: System) -> bool:
    return any(joint.kind == "free" for joint in system.robot.joints) or system.robot.base_dofs.stop > 1


def posed(system: System, pose: dict[str, float]) -> Any:
    """Data of the robot in a pose, everything derived from it.

    Raises:
        InputError: No run can start from there.
    """
    data = mujoco.MjData(system.mj)
    for name, value in pose.items():
        data.qpos[system.joint(f"robot/{name}").qpos] = value
    if fault := fault_of_start(system, data):
        raise InputError(f"{system.files['robot'].place}: in its starting pose {fault}")
    return data


def find_tip(system: System, data: Any, wanted: str) -> Tip:
    """The end of a robot: what is asked for, or a site or an empty frame of its last link, or where that link ends.

    Args:
        system: The robot.
        data: Its pose.
        wanted: Name of a site or of a body; empty: to be found.

    Raises:
        InputError: There is no such site or body.
    """
    model = system.mj
    sites, bodies = _of_robot(system, "site"), _of_robot(system, "body")
    if wanted in sites:
        site = model.site(f"robot/{wanted}")
        return Tip(wanted, int(site.bodyid[0]), np.array(site.pos))
    if wanted in bodies:
        return Tip("", int(model.body(f"robot/{wanted}").id), np.zeros(3))
    if wanted:
        raise InputError(f"new: --tip: {unknown_name('site or body', wanted, [*sites, *bodies])}")
    last = _last_link(system)
    link = np.flatnonzero(model.body_weldid == model.body_weldid[last]).tolist()
    anchor = data.xpos[model.body_weldid[last]]
    filled = set(model.geom_bodyid.tolist())
    frames = [
        (float(np.linalg.norm(data.site_xpos[s] - anchor)), model.site(s).name.split("/", 1)[1], int(model.site_bodyid[s]))
        for s in range(model.nsite)
        if model.site_bodyid[s] in link
    ] or [(float(np.linalg.norm(data.xpos[b] - anchor)), "", int(b)) for b in link if b not in filled]
    distance, site_name, body = max(frames, default=(0.0, "", 0))
    if distance > 1e-3:
        local = np.array(model.site(f"robot/{site_name}").pos) if site_name else np.zeros(3)
        return Tip(site_name, body, local)
    end = _end_of(model, data, last, link)
    beyond = data.xpos[last] + data.xmat[last].reshape(3, 3) @ end - anchor
    if beyond @ outward(model, data, last) < 0.0:  # the link is on the arm's side of its joint, which is at its flange
        return Tip("", int(model.body_weldid[last]), np.zeros(3))
    return Tip("", last, end)


def outward(model: Any, data: Any, body: int) -> FloatArray:
    """Vector from the link before to the last joint of a body, in world axes, m: away from the arm."""
    anchor = data.xpos[model.body_weldid[body]]
    before = (anchor - data.xpos[model.body_weldid[b]] for b in ancestors(model, body))
    return np.asarray(next((way for way in before if np.linalg.norm(way) > 1e-3), np.zeros(3)))


def _of_robot(system: System, kind: str) -> list[str]:
    return [name.split("/", 1)[1] for name in system.names(kind) if name.startswith("robot/")]


def _last_link(system: System) -> int:
    """The body with most joints between it and the base; of a hand with fingers alike, the hand.

    A hand is beyond half of the joints, or has a site, as a gripper without an arm has between its fingers.
    """
    model = system.mj
    above = {system.robot.root: 0}
    for body in system.robot.bodies[1:]:
        above[body] = above[int(model.body_parentid[body])] + int(model.body_jntnum[body])
    most = max(above.values())
    ends = [body for body, joints in above.items() if joints == most and model.body_jntnum[body]]
    if len(ends) > 1:
        chains = [list(ancestors(model, body)) for body in ends]
        hand = next(body for body in chains[0] if all(body in chain for chain in chains))
        if above[hand] >= most / 2 or (hand != system.robot.root and hand in model.site_bodyid):
            return hand
    return ends[0]


def _end_of(model: Any, data: Any, body: int, link: list[int]) -> FloatArray:
    """Where a link ends, in the frame of a body of it: its surface beyond the geoms of this body, as seen from its joint."""
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] in link]
    if not geoms:
        return np.zeros(3)
    of_body = [g for g in geoms if model.geom_bodyid[g] == body] or geoms
    anchor, middle = data.xpos[model.body_weldid[body]], np.mean(data.geom_xpos[of_body], axis=0)
    along = middle - anchor
    length = float(np.linalg.norm(along))
    along = along / length if length > 1e-3 else data.xmat[body].reshape(3, 3)[:, 2]
    far = length + float(max(model.geom_rbound[geoms])) + 1.0
    hits = [far - distance for g in geoms if (distance := ray_distance(model, data, g, anchor + far * along, -along)) >= 0.0]
    reach = max(hits, default=length)
    return np.asarray(data.xmat[body].reshape(3, 3).T @ (anchor + reach * along - data.xpos[body]))


def ray_distance(model: Any, data: Any, geom: int, start: FloatArray, direction: FloatArray) -> float:
    """Distance from a point along a unit vector to a geom, m; below zero where it misses."""
    kind = int(model.geom_type[geom])
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        return float(mujoco.mj_rayMesh(model, data, geom, start, direction, None))
    position, turn, size = data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom]
    return float(mujoco.mju_rayGeom(position, turn, size, start, direction, kind, None))


def solid_geoms(system: System) -> list[int]:
    """Geoms of the robot that may touch a ball, whose contype and conaffinity are 1 by default."""
    model = system.mj
    of_robot = [g for g in range(model.ngeom) if model.geom_bodyid[g] in system.robot.bodies]
    return [g for g in of_robot if (model.geom_contype[g] | model.geom_conaffinity[g]) & 1]


def hand_geoms(system: System, tip: Tip) -> Iterator[list[int]]:
    """Solid geoms of the link that the tip is on and of all beyond it, then with those of each link before."""
    model, last = system.mj, 0
    solid = solid_geoms(system)
    for body in ancestors(model, int(model.body_weldid[tip.body])):
        group = [g for g in solid if body in ancestors(model, int(model.geom_bodyid[g]))]
        if len(group) > last:
            yield group
        last = len(group)


def find_approach(
    system: System, data: Any, place: FloatArray, geoms: list[int], pairs: list[ContactPair]
) -> Approach | None:
    """A straight line along which the ball comes from outside and touches one of some geoms first; None if there is none.

    Args:
        system: Robot and ball.
        data: The pose; the ball's place in it is written.
        place: The tip in the world, m, (3,).
        geoms: The geoms that may be touched.
        pairs: The ball with every geom of the robot that may touch.
    """
    model = system.mj
    aim = min((data.geom_xpos[g] for g in geoms), key=lambda centre: float(np.linalg.norm(centre - place)))
    outwards = place - data.subtree_com[system.robot.root]
    # Along the last link, away from the robot, then along the axes of the world and between them.
    ways = [place - aim, outwards, *sorted(product((-1.0, 0.0, 1.0), repeat=3), key=np.count_nonzero)]
    ball = system.objects[0].joints[0].qpos.start
    reach = 2.0 * float(max(np.linalg.norm(data.geom_xpos[g] - aim) + model.geom_rbound[g] for g in range(model.ngeom - 1)))
    for way in ways:
        if (length := float(np.linalg.norm(way))) < 1e-6:
            continue
        direction, left = np.asarray(way) / length, reach + float(model.geom_rbound[model.ngeom - 1])
        for _ in range(_MOST_MARCHES):
            data.qpos[ball : ball + 3] = aim + left * direction
            mujoco.mj_kinematics(model, data)
            gap, first = min((pair.gap(model, data, 10 * reach), i) for i, pair in enumerate(pairs))
            if gap < _CLOSE:
                if pairs[first].geom_ids & set(geoms):
                    return Approach(aim + left * direction, direction, pairs[first].body_a)
                break
            left -= gap
            if left < 0.0:
                break
    return None


def felt_mass(system: System, data: Any, met: Approach) -> float:
    """Mass in kg that the robot, everything in it free, opposes to a push where the ball touches it."""
    model = system.mj
    jacobian = np.empty((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, met.touch, met.body)
    along = met.outwards @ jacobian
    return float(1.0 / (along @ np.linalg.solve(mass_matrix(model, data), along)))
