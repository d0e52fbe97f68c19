"""Geometry of a capture, worked out from the compiled models: the arm's pose, the point to grasp, and how all begins.

The world frame is that of the bus at the capture. The arm's tool, a frame with x out of the hand, and the grapple, a frame
on the target with x into it, coincide there. Poses of the arm are drawn from the ranges of its joints. Of those in which
nothing touches, from the start of the mission on, the one is taken from which the tool moves best every way, also a little
behind the grapple, where the arm waits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.model.system import System, ancestors, followers
from ffsm_mj.templates.pose import Tip, outward, ray_distance

_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_ON_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_DRAWN, _TRIED = 3000, 60
"""Poses of the arm that are drawn, and the best of them that are tried with the target."""
_MARGIN = 0.1
"""Of the range of a joint, which is left to its limits."""
_ALONG = math.cos(math.radians(30.0))
"""A tool that is this near to the axis of the last joint points along it."""
_BEHIND = 0.15
"""Way between waiting and grasping, of the reach of the arm."""
_LEVER = 0.3
"""Length by which turns count as motions, of the reach of the arm."""
_LEAST_MOBILITY = 0.02
"""Least singular value of the tool's Jacobian, turns over a length, of the reach: no pose is nearer to a singularity."""
_CLEAR, _TOUCHING_M = 0.08, 0.02
"""Least gap between target and robot at the capture, of the reach of the arm, and between target and hand, m."""
_STAND_OFF_M = (0.03, 0.05, 0.08, 0.12, 0.2, 0.3)
"""Distances of the grapple from the surface of the target, m: the first one is taken at which the hand has room."""
_STEPS, _CLOSE = 60, 1e-9
MOVING_S, APPROACH_S, STAND_OFF_S, CLOSE_IN_S, DETUMBLE_S = 40.0, 50.0, 15.0, 10.0, 30.0
"""Times of the mission: of the bus on its way, of the approach with it, of waiting behind the grapple, of the way to it, and
the longest one of detumbling."""
DURATION_S = APPROACH_S + STAND_OFF_S + CLOSE_IN_S + DETUMBLE_S + 25.0
WAY_M = 1.0
"""Way of the bus to the place of the capture."""
_SPIN = np.array([0.012, 0.004, -0.006])
"""Angular velocity of the target at the capture, rad/s, in the axes of the grapple: mostly about the axis of the hand."""
_PASSING_M = 0.03
"""Least gap between target and robot while the bus approaches, m."""
_LOOKS = 60
"""Looks at the motion of the target before the capture."""


class Arm(NamedTuple):
    """The joints between bus and hand that a motor or servo drives, and the tool.

    Attributes:
        joints: Full names.
        qpos: Their places in ``qpos``, (n,).
        dofs: Their places in ``qvel``, (n,).
        actuators: Ids of their actuators, (n,).
        low: Ends of the ranges that are used, (n,).
        high: See ``low``.
        body: Body of the tool.
        tool: The tool in its frame, x out of the hand.
    """

    joints: tuple[str, ...]
    qpos: IntArray
    dofs: IntArray
    actuators: IntArray
    low: FloatArray
    high: FloatArray
    body: int
    tool: Pose


class Pose(NamedTuple):
    """Pose of a frame: its origin in m, (3,), and its axes as columns, (3, 3)."""

    origin: FloatArray
    axes: FloatArray

    def of(self, inner: Pose) -> Pose:
        """Pose of a frame that is given in this one, where this one is given."""
        return Pose(self.origin + self.axes @ inner.origin, self.axes @ inner.axes)

    @property
    def inverse(self) -> Pose:
        """Pose of the outer frame in this one."""
        return Pose(-self.axes.T @ self.origin, self.axes.T)

    @property
    def quaternion(self) -> FloatArray:
        """Orientation w, x, y, z, (4,)."""
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(self.axes).ravel())
        return quaternion


def _of_body(data: Any, body: int) -> Pose:
    return Pose(data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy())


class Moment(NamedTuple):
    """State of the target at a time of the mission.

    Attributes:
        time_s: The time, s.
        pose: Of the frame of its root: x, y, z in m and a quaternion w, x, y, z, (7,).
        rates: Velocity of its origin in m/s, world axes, and angular velocity in rad/s, its own axes, (6,).
    """

    time_s: float
    pose: FloatArray
    rates: FloatArray


class GraspPlan(NamedTuple):
    """A capture that the arm can reach.

    Attributes:
        ready: Coordinates of the joints in which the arm waits, (n,).
        way: Distance between tool and grapple while it waits, m.
        turns: Whether the arm turns the tool every way, not only moves it.
        grapple: The grapple in the frame of the target's root.
        bus: Place of the bus at the start, m, (3,).
        target: State of the target at the start.
    """

    ready: FloatArray
    way: float
    turns: bool
    grapple: Pose
    bus: FloatArray
    target: Moment


def find_arm(system: System, data: Any, tip: Tip, *, at_end: bool) -> Arm:
    """The arm of a robot on a bus, with its tool at a tip.

    Args:
        system: The robot, and a target.
        data: A pose.
        tip: The tip.
        at_end: Whether the tool is moved out of the hand to where its fingers end: the tip is of no site.

    Raises:
        InputError: Too few joints between bus and tip are driven.
    """
    model, follow = system.mj, followers(system.mj)
    chain = set(ancestors(model, tip.body))
    on_joint = model.actuator_trntype == _ON_JOINT
    drives = {int(model.actuator_trnid[a, 0]): a for a in np.flatnonzero(on_joint).tolist()}
    ids = [
        j
        for j in range(model.njnt)
        if model.jnt_bodyid[j] in chain and model.jnt_type[j] in (_HINGE, _SLIDE) and j in drives and j not in follow
    ]
    if len(ids) < 3:
        raise InputError(f"new: {len(ids)} driven joints move the tip; a capture needs three or more (--tip names another)")
    limited = model.jnt_limited[ids].astype(bool)
    hinges = model.jnt_type[ids] == _HINGE
    ends = np.where(hinges, math.pi, 1.0)
    low = np.where(limited, np.maximum(model.jnt_range[ids, 0], -ends), -ends)
    high = np.where(limited, np.minimum(model.jnt_range[ids, 1], ends), ends)
    margin = _MARGIN * (high - low)
    turned = data.xmat[tip.body].reshape(3, 3)
    place = data.xpos[tip.body] + turned @ tip.local
    axes = _tool_axes(data, ids[-1], place, turned, outward(model, data, tip.body))
    if at_end:
        place = place + _beyond(system, data, tip, place, axes[:, 0]) * axes[:, 0]
    return Arm(
        tuple(model.joint(j).name for j in ids),
        model.jnt_qposadr[ids],
        model.jnt_dofadr[ids],
        np.array([drives[j] for j in ids], dtype=np.intp),
        low + margin,
        high - margin,
        tip.body,
        Pose(turned.T @ (place - data.xpos[tip.body]), turned.T @ axes),
    )


def _beyond(system: System, data: Any, tip: Tip, place: FloatArray, along: FloatArray) -> float:
    """How far the geoms of a hand reach beyond a place along a unit vector, m, by the boxes around them; 0 at least."""
    model = system.mj
    link = int(model.body_weldid[tip.body])
    geoms = [g for g in range(model.ngeom) if link in ancestors(model, int(model.geom_bodyid[g]))]
    ends = [0.0]
    for g in geoms:
        centre, half = np.split(model.geom_aabb[g], 2)
        turned = data.geom_xmat[g].reshape(3, 3)
        ends.append(float(along @ (data.geom_xpos[g] + turned @ centre - place) + np.abs(along @ turned) @ half))
    return max(ends)


def _tool_axes(data: Any, joint: int, place: FloatArray, body: FloatArray, out: FloatArray) -> FloatArray:
    """World axes of a tool: x from the last joint to the tip, or along that joint out of the arm where this is nearly so."""
    along, joint_axis = place - data.xanchor[joint], data.xaxis[joint]
    length = float(np.linalg.norm(along))
    x = along / length if length > 1e-3 else math.copysign(1.0, float(joint_axis @ out)) * joint_axis
    if abs(x @ joint_axis) > _ALONG:
        x = math.copysign(1.0, float(x @ joint_axis)) * joint_axis
    side = body[:, int(np.argmin(np.abs(x @ body)))]
    y = side - (side @ x) * x
    y /= np.linalg.norm(y)
    return np.column_stack((x, y, np.cross(x, y)))


class Kinematics:
    """Tool of an arm in poses of its joints, with the bus at the origin.

    Attributes:
        reach: Greatest distance of the tool from the first joint in some poses, m.
    """

    def __init__(self, system: System, arm: Arm, data: Any) -> None:
        """Take an arm and the pose of all else of the robot."""
        self.model, self.arm, self.data = system.mj, arm, data
        self._jacobian = np.empty((6, system.mj.nv))
        base = system.robot.joints[0].qpos
        data.qpos[base] = [0, 0, 0, 1, 0, 0, 0]
        self._draw = np.random.default_rng(0)
        poses = self._draw.uniform(arm.low, arm.high, (_DRAWN, len(arm.joints)))
        tools = np.array([self.at(q).origin for q in poses])
        self._drawn = poses, tools
        self._first = data.xanchor[int(system.mj.dof_jntid[arm.dofs[0]])].copy()
        self.reach = float(np.linalg.norm(tools - self._first, axis=1).max())

    def at(self, q: FloatArray) -> Pose:
        """The tool at coordinates of the joints."""
        data, arm = self.data, self.arm
        data.qpos[arm.qpos] = q
        mujoco.mj_kinematics(self.model, data)
        return _of_body(data, arm.body).of(arm.tool)

    def jacobian(self, tool: Pose) -> FloatArray:
        """Rates of the tool by those of the joints at the pose last asked for, turns over a length, m, (6, n)."""
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_jac(self.model, self.data, self._jacobian[:3], self._jacobian[3:], tool.origin, self.arm.body)
        rates = self._jacobian[:, self.arm.dofs]
        rates[3:] *= _LEVER * self.reach
        return rates

    def mobility(self, tool: Pose, rows: int) -> float:
        """Least singular value of the Jacobian, of the reach: 0 at a singularity; its first rows only."""
        rates = self.jacobian(tool)[:rows]
        return float(np.linalg.svd(rates, compute_uv=False)[rows - 1] / self.reach) if rates.shape[1] >= rows else 0.0

    def rows(self) -> int:
        """6 where the arm turns its tool every way, or 3 where it only moves it.

        Raises:
            InputError: It cannot even do that.
        """
        best = {6: 0.0, 3: 0.0}
        for q in self._drawn[0][:50]:
            tool = self.at(q)
            best = {rows: max(least, self.mobility(tool, rows)) for rows, least in best.items()}
        movable = next((rows for rows, least in best.items() if least > _LEAST_MOBILITY), 0)
        if not movable:
            raise InputError("new: the arm cannot move its tip every way; a capture needs that (--tip names another)")
        return movable

    def candidates(self, rows: int, top: float, way: float) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Coordinates at the capture and where the arm waits, the best first.

        Args:
            rows: Components of the motion that count.
            top: Height of the upper face of the bus, m. The tool is above it, and the better the more it points up and away
                from the first joint: what it holds is then out of the way of bus and arm.
            way: Distance between the two, m.
        """
        scored = []
        for i, place in enumerate(self._drawn[1]):
            if place[2] < top + 0.2 * self.reach:
                continue
            tool = self.at(self._drawn[0][i])
            outwards = tool.origin - self._first
            away = float(tool.axes[:, 0] @ outwards / np.linalg.norm(outwards))
            if tool.axes[2, 0] > 0.2 and away > 0.0:
                scored.append((self.mobility(tool, rows) * (tool.axes[2, 0] + away), i))
        for _, i in sorted(scored, reverse=True)[:_TRIED]:
            grasping = self._drawn[0][i]
            tool = self.at(grasping)
            ready = self.solved(grasping, Pose(tool.origin - way * tool.axes[:, 0], tool.axes), rows)
            if ready is not None and min(self.mobility(self.at(q), rows) for q in (ready, grasping)) > _LEAST_MOBILITY:
                yield grasping, ready

    def solved(self, start: FloatArray, wanted: Pose, rows: int) -> FloatArray | None:
        """Coordinates within the ranges at which the tool is somewhere, by Newton's method; None: not found."""
        q, turn = start.copy(), np.empty(3)
        for _ in range(_STEPS):
            tool = self.at(q)
            mujoco.mju_quat2Vel(turn, Pose(tool.origin, wanted.axes @ tool.axes.T).quaternion, 1.0)
            error = np.concatenate((wanted.origin - tool.origin, _LEVER * self.reach * turn))[:rows]
            if np.linalg.norm(error) < _CLOSE:
                return q if (q >= self.arm.low).all() and (q <= self.arm.high).all() else None
            step = np.linalg.pinv(self.jacobian(tool)[:rows], rcond=1e-4) @ error
            q = q + step * min(1.0, 0.2 / float(np.abs(step).max()))
        return None


def plan_grasp(system: System, alone: System, data: Any, arm: Arm, top: float, grapple: str) -> GraspPlan:
    """A capture that the arm can reach, and in which nothing touches.

    Args:
        system: Robot and target.
        alone: The target alone.
        data: Pose of all but the arm and the target.
        arm: The arm.
        top: Height of the upper face of the bus, m.
        grapple: Name of a site of the target to grasp it at; empty: in front of one of its faces.

    Raises:
        InputError: There is none.
    """
    reached = Kinematics(system, arm, data)
    rows, way = reached.rows(), _BEHIND * reached.reach
    clearance = _Clearance(system, data, arm)
    grapples = [_site_grapple(system, data, grapple)] if grapple else _face_grapples(system, data)
    poses = [pair for pair in reached.candidates(rows, top, way) if reached.at(pair[0]) and clearance.folded_well()]
    best = -math.inf
    for frames, (grasping, ready) in product(grapples, poses):
        tool = reached.at(grasping)
        room = [
            min(gap - _CLEAR * reached.reach, hand - _TOUCHING_M)
            for gap, hand in (clearance.at(tool.of(g.inverse)) for g in frames)
        ]
        most = int(np.argmax(np.round(room, 3)))  # of those that are alike the first
        if room[most] >= 0.0:
            frame, bus = frames[most], -WAY_M * tool.axes[:, 0]
            history = motion_before(alone, tool.of(frame.inverse), frame.axes @ _SPIN)
            reached.at(ready)
            passing = min(min(clearance.at(seen)) for seen in _seen_from(bus, history)) - _PASSING_M
            if passing >= 0.0:
                return GraspPlan(ready, way, rows == 6, frame, bus, history[0])
            room[most] = passing
        best = max(best, room[most])
    where = f"site {grapple!r} of the target" if grapple else "a face of the target"
    lacking = f"; the best one lacks {-best:.2g} m of room" if math.isfinite(best) else ""
    raise InputError(
        f"new: --target: no pose of the arm was found (reach {reached.reach:.2g} m, of {_DRAWN} drawn) in which its tip is "
        f"at {where} and nothing else touches{lacking}; a smaller target, --grapple or --tip may help"
    )


def _site_grapple(system: System, data: Any, name: str) -> list[Pose]:
    """Grapples at a site, in the frame of the root: x along its axis that points inwards most, turned four ways.

    Raises:
        InputError: The target has no such site.
    """
    names = [full.removeprefix("target/") for full in system.names("site") if full.startswith("target/")]
    if name not in names:
        raise InputError(f"new: --grapple: {unknown_name('site of the target', name, names)}")
    model, root = system.mj, system.objects[0].root
    mujoco.mj_forward(model, data)
    site = model.site(f"target/{name}").id
    frame = _of_body(data, root).inverse.of(Pose(data.site_xpos[site], data.site_xmat[site].reshape(3, 3)))
    centre = data.xmat[root].reshape(3, 3).T @ (data.subtree_com[root] - data.xpos[root])
    inwards = max(
        (s * frame.axes[:, k] for k in range(3) for s in (1.0, -1.0)), key=lambda x: float(x @ (centre - frame.origin))
    )
    return _turned(frame.origin, inwards)


def _face_grapples(system: System, data: Any) -> list[list[Pose]]:
    """Grapples before the six faces of the target, towards its centre of mass, by their distance from the surface.

    Faces near the centre come first.

    Raises:
        InputError: The target has no surface.
    """
    model, root = system.mj, system.objects[0].root
    mujoco.mj_forward(model, data)
    frame, centre = _of_body(data, root), data.subtree_com[root].copy()
    solid = model.geom_contype | model.geom_conaffinity
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] in system.objects[0].bodies and solid[g]]
    if not geoms:
        raise InputError(
            "new: --target: no geom of it can touch anything, so there is no surface to grasp it at; --grapple names a site"
        )
    far = 2.0 * float(max(np.linalg.norm(data.geom_xpos[g] - centre) + model.geom_rbound[g] for g in geoms)) + 1.0
    faces = list[tuple[float, int, FloatArray]]()
    for k, sign in product(range(3), (-1.0, 1.0)):
        outwards = sign * frame.axes[:, k]
        hits = [d for g in geoms if (d := ray_distance(model, data, g, centre + far * outwards, -outwards)) >= 0.0]
        if hits:
            faces.append((round(far - min(hits), 6), len(faces), frame.axes.T @ outwards))
    local = frame.axes.T @ (centre - frame.origin)
    faces.sort(key=lambda face: face[:2])
    return [
        [pose for depth, _, out in faces for pose in _turned(local + (depth + stand_off) * out, -out)]
        for stand_off in _STAND_OFF_M
    ]


def _turned(origin: FloatArray, inwards: FloatArray) -> list[Pose]:
    """Frames with x along a vector, turned about it by quarters."""
    side = np.eye(3)[int(np.argmin(np.abs(inwards)))]
    y = side - (side @ inwards) * inwards
    y /= np.linalg.norm(y)
    z = np.cross(inwards, y)
    turns = ((y, z), (z, -y), (-y, -z), (-z, y))
    return [Pose(origin, np.column_stack((inwards, one, other))) for one, other in turns]


class _Clearance:
    """Gaps between the geoms of a robot and a target."""

    def __init__(self, system: System, data: Any, arm: Arm) -> None:
        model = system.mj
        self._model, self._data, self._free = model, data, system.objects[0].joints[0].qpos
        robot, target = ([g for g in range(model.ngeom) if model.geom_bodyid[g] in t.bodies] for t in system.trees[:2])
        last = int(model.body_weldid[arm.body])
        self._hand = {g for g in robot if last in ancestors(model, int(model.geom_bodyid[g]))}
        self._pairs = [(a, b) for a in robot for b in target if _may_touch(model, a, b)]
        # Links that are three joints apart or more, and the bus: those that are nearer overlap as their maker drew them.
        depth = {g: sum(int(model.body_jntnum[b]) for b in ancestors(model, int(model.geom_bodyid[g]))) for g in robot}
        self._links = [(a, b) for a, b in product(robot, robot) if depth[b] - depth[a] >= 3 and _may_touch(model, a, b)]

    def folded_well(self) -> bool:
        """Whether no link of the arm overlaps another one, or the bus."""
        return all(self._gap(a, b) > 0.0 for a, b in self._links)

    def at(self, target: Pose) -> tuple[float, float]:
        """Least gap of the target, in a pose, to what is not the hand, and to the hand, m, 1 at most."""
        self._data.qpos[self._free] = [*target.origin, *target.quaternion]
        mujoco.mj_kinematics(self._model, self._data)
        gaps = [(self._gap(a, b), a in self._hand) for a, b in self._pairs]
        of_hand, others = (min((gap for gap, hand in gaps if hand == is_hand), default=1.0) for is_hand in (True, False))
        return others, of_hand

    def _gap(self, a: int, b: int) -> float:
        return float(mujoco.mj_geomDistance(self._model, self._data, a, b, 1.0, None))


def _may_touch(model: Any, a: int, b: int) -> bool:
    kinds, affine = model.geom_contype, model.geom_conaffinity
    return bool((kinds[a] & affine[b]) | (kinds[b] & affine[a]))


def _seen_from(start: FloatArray, history: list[Moment]) -> Iterator[Pose]:
    """Poses of the target as the bus sees them on its way, which begins at a place in m, (3,): a path of least jerk."""
    for moment in history:
        tau = min(moment.time_s / MOVING_S, 1.0)
        bus = start * (1.0 - tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2))
        yield Pose(moment.pose[:3] - bus, rotation_matrix(moment.pose[3:]))


def motion_before(alone: System, at: Pose, spin: FloatArray) -> list[Moment]:
    """States of a free body from the start of the mission to the end of the approach, its centre of mass at rest.

    The motion is run backwards from the capture.

    Args:
        alone: The body alone.
        at: Pose of its root at the capture.
        spin: Its angular velocity then, in its own axes, rad/s, (3,).
    """
    model, data, root = alone.mj, mujoco.MjData(alone.mj), alone.robot.root
    joint = alone.robot.joints[0]
    data.qpos[joint.qpos] = [*at.origin, *at.quaternion]
    mujoco.mj_forward(model, data)
    lever = data.xpos[root] - data.subtree_com[root]
    data.qvel[joint.dofs] = [*-np.cross(at.axes @ spin, lever), *-spin]
    end = APPROACH_S + STAND_OFF_S + CLOSE_IN_S
    steps = round(end / model.opt.timestep)
    every, moments = max(1, steps // _LOOKS), list[Moment]()
    for step in range(1, steps + 1):
        mujoco.mj_step(model, data)
        time_s = end * (1.0 - step / steps)
        if time_s <= APPROACH_S and (step == steps or step % every == 0):
            moments.append(Moment(time_s, data.qpos[joint.qpos].copy(), -data.qvel[joint.dofs]))
    return moments[::-1]
