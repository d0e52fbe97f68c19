"""Closed loops: equality constraints of the models and further closed grasps, held by rows in every stage of a step.

Equality constraints of the model files are rows of every motion of a run, from its start on. The first closed grasp attaches
its object as a child body: the motion is that of another model. A grasp that closes while another one is closed is a latch
in the model of the first, held by rows (:mod:`ffsm_mj.dynamics.loops.closed_loops`), after persistent contact, so that it
sees all other forces. Contacts, impacts and projections see the model with the loops closed through :attr:`Motion.loops
<ffsm_mj.dynamics.motion.Motion.loops>`, which this source of forces sets.

Where rows depend on each other, as two rigid grasps of one object by a planar robot or the closed loop of a planar linkage,
the motion is unique and the forces are those of least norm.

A further grasp as a latch between two bodies: its pose at the closing, and the latch that these numbers give.

Energy and momentum that closed loops exchange between subsystems, from the stages of a step.

Rows do no work on the whole system: what they give to the objects, they take from the robot. A grasped object counts as a
part of the robot (see ``balance/exchange.py``), so that a second grasp of it exchanges nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj._core.mechanisms import LoadSample, SteadyLoops
from ffsm_mj._core.stages import Smooth
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.interface import ForceOrder, ForceSource, Scene
from ffsm_mj.contact_models.persistent.exchange import robot_dofs
from ffsm_mj.contact_models.state_projection import StateProjection, exchange_signs, sum_exchanges
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops, RowSource
from ffsm_mj.dynamics.loops.couplings import JointCoupling
from ffsm_mj.dynamics.loops.equalities import Equality, equalities_of
from ffsm_mj.dynamics.loops.latch import LatchedBodies, axes_about, stopped_along_axes
from ffsm_mj.dynamics.motion import Motion, rigid_pairs
from ffsm_mj.dynamics.projection import needs_projection, no_contacts
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.contact_forces import Wrench
from ffsm_mj.records.signals import Signal, identifier
from ffsm_mj.state import entries
from ffsm_mj.tolerances import MECHANISM_RANK, RANK


class ClosingPose(NamedTuple):
    """Pose of the object's body in the frame of the link at the closing of a grasp.

    Numbers for the record of the closing: a log replay makes the same latch of them, bit by bit.

    Attributes:
        position_m: Position of the body of the object's site in the frame of the body of the robot's site, m.
        quaternion: Its orientation there, (w, x, y, z).
    """

    position_m: tuple[float, ...]
    quaternion: tuple[float, ...]


def closing_pose(system: System, data: Any, grasp: Grasp) -> ClosingPose:
    """Relative pose of the bodies of a grasp at the state in ``data`` of the logged system, kinematics current."""
    link, body = _bodies(system, grasp)
    position = data.xmat[link].reshape(3, 3).T @ (data.xpos[body] - data.xpos[link])
    back, quaternion = np.empty(4), np.empty(4)
    mujoco.mju_negQuat(back, data.xquat[link])
    mujoco.mju_mulQuat(quaternion, back, data.xquat[body])
    # The product of two unit quaternions is one up to rounding only, and the record keeps it for every replay.
    mujoco.mju_normalize4(quaternion)
    return ClosingPose(tuple(position.tolist()), tuple(quaternion.tolist()))


def loop_latch(system: System, grasp: Grasp, pose: ClosingPose) -> LatchedBodies:
    """Latch of a grasp between bodies of the logged system, with what its joint leaves free.

    Where the frames of the two sites are not aligned at the closing, they stay as they are, and the axis is the robot's. For
    kinds with freedom any later pose of a closed grasp gives the same latch, up to drift.

    Args:
        system: The logged system.
        grasp: The grasp.
        pose: Pose at the closing.
    """
    model = system.mj
    robot, object_site = system.index("site", grasp.robot_site), system.index("site", grasp.object_site)
    axes = rotation_matrix(model.site_quat[robot]) @ axes_about(grasp.joint.axis)
    stopped = stopped_along_axes(grasp.joint.kind)
    return LatchedBodies.at_pose(_bodies(system, grasp), np.array(model.site_pos[object_site]), axes, stopped, *pose)


def _bodies(system: System, grasp: Grasp) -> tuple[int, int]:
    """Ids of the bodies of the robot's site and the object's."""
    sites = (system.index("site", name) for name in (grasp.robot_site, grasp.object_site))
    link, body = (int(system.mj.site_bodyid[site]) for site in sites)
    return link, body


class LoopExchange:
    """Sums up what latches exchange in a (sub-)step.

    Attributes:
        outside: Whether latches join fixed bodies with the robot, and with objects, (2,).
        crosses: Whether rows join different subsystems.
        to_fixed_bodies: Unit wrenches that fixed bodies take through latches, (k, 6): all six or none.
    """

    def __init__(self, scene: Scene) -> None:
        """Initialise with no latches."""
        self._scene = scene
        self.outside: BoolArray = np.zeros(2, dtype=np.bool_)
        self.to_fixed_bodies: FloatArray = np.empty((0, 6))
        self.crosses = False
        self._stages: list[tuple[FloatArray, float]] = []

    def bind(self, motion: Motion, sources: Sequence[RowSource]) -> None:
        """Use a motion with some rows held."""
        self._motion, self._robot = motion, robot_dofs(self._scene.system, motion)
        latches = {i: source for i, source in enumerate(sources) if isinstance(source, LatchedBodies)}
        bodies = [(latch.first, latch.second) for latch in latches.values()]
        # A grasped object counts as a part of the robot, so a second grasp of it exchanges nothing.
        signs = [exchange_signs(self._scene.system, *both, motion.grasped_bodies) for both in bodies]
        self._signs = np.array(signs).reshape(-1, 3)
        self._places = [*latches]
        self.outside = np.any(self._signs[:, 1:] != 0.0, axis=0)
        self.to_fixed_bodies = np.eye(6) if self.outside.any() else np.empty((0, 6))
        # Between robot and objects, by a latch or by a coupling of joints; with fixed bodies a latch passes momentum and no
        # power.
        self._passes_power = bool(self._signs[:, 0].any()) or any(self._couples(source) for source in sources)
        self.crosses = bool(self._signs.any()) or self._passes_power
        self.clear()

    def _couples(self, source: RowSource) -> bool:
        """Whether a coupling of joints passes power between the robot and objects: efforts at joints pass no momentum."""
        # Only couplings of two joints pass power from one to the other: a locked joint does no work.
        if not isinstance(source, JointCoupling) or source.leader is None:
            return False
        robot = range(self._robot.start, self._robot.stop)
        return len({self._motion.dofs[dof] in robot for dof in (source.follower, source.leader)}) > 1

    def clear(self) -> None:
        """Discard the stages of the last step."""
        self._stages.clear()

    def add_stage(self, forces: FloatArray, generalised: FloatArray) -> None:
        """Add a stage of a step.

        Args:
            forces: Forces of all rows, (n,).
            generalised: Their generalised forces, (nv,).
        """
        loops, stepper, data = self._motion.loops, self._motion.forced_stepper, self._motion.data
        if loops is None or stepper is None:
            return
        wrenches = np.empty((len(self._signs), 6))
        for i, wrench in zip(self._places, wrenches, strict=True):
            point, wrench[:3], wrench[3:] = loops.wrench(i, forces)
            # About the world origin, as the momenta of the balance.
            wrench[3:] += np.cross(point, wrench[:3])
        power = float(generalised[self._robot] @ data.qvel[self._robot])
        # An implicit step evaluates each of its stages repeatedly: the last evaluation counts.
        if stepper.repeats:
            self._stages[stepper.repeats] = wrenches, power
        else:
            self._stages.append((wrenches, power))

    def over(self, duration_s: float, projected: Exchange | None) -> Exchange | None:
        """Exchange in the (sub-)step, with that of the projection at its start, if any."""
        stepper = self._motion.forced_stepper
        if not self.crosses or stepper is None:
            return projected
        # Weights of the tableau that made the step: Radau IIA has three nodes, RK4 four stages.
        weights = duration_s * stepper.weights
        # The last entry of all is the evaluation at the end of the step.
        stages = self._stages[-1 - len(weights) : -1]
        impulses = np.einsum("s,slc->lc", weights, np.array([wrenches for wrenches, _ in stages]))
        on_objects, *outside = self._signs.T @ impulses
        # The quadrature of the stages is that of the motion, so the balance closes to its order, and momenta to rounding.
        of_robot = float(weights @ [power for _, power in stages])
        # Fixed bodies take no power: what the robot gains, objects that move lose.
        of_objects = 0.0 if self.outside.any() and not self._passes_power else -of_robot
        return sum_exchanges(projected, Exchange(np.array((0.0, of_robot, of_objects)), on_objects, np.array(outside)))


_TAKES_PART = 1e-9
"""Share of a row in a combination that vanishes, of norm 1, from which on its load is not unique: above its rounding."""


@dataclass(frozen=True)
class LoopClosing:
    """Closing of a latch while others are closed: a plastic impulse on the rows of all of them.

    Attributes:
        wrenches: Impulse in N s, and its moment about the object's site in N m s, on the object of each closed latch by
            name, world axes, (6,); of least norm where rows depend on each other.
        change: Change of the generalised velocity of the motion, (nv,).
        loss_J: Kinetic energy lost.
        rank: Number of relative motions that the latch stops and that were possible before.
        stops: Number of rows of the latch; the impulses on it are unique only if ``rank`` is as large.
        least_ratio: Smallest singular value of the rows over the largest; below 1e-6 the mechanism is nearly singular.
        mobility: Degrees of freedom of the motion that are left.
    """

    wrenches: dict[str, FloatArray]
    change: FloatArray
    loss_J: float
    rank: int
    stops: int
    least_ratio: float
    mobility: int


class _LoopState(NamedTuple):
    """Forces at one state: tokens of state and forces, those of all rows, generalised ones, a wrench by index of a latch."""

    kinematics: object
    load: object
    forces: FloatArray
    generalised: FloatArray
    wrenches: dict[int, tuple[FloatArray, FloatArray, FloatArray]]


class LoopForces(ForceSource):
    """Forces of equality constraints and of further closed grasps; see :class:`~ffsm_mj.contact_models.interface.Source`.

    It has no events: the grasp model closes and opens the latches of grasps. It must stand before persistent contact among
    the contact models, which then finds the loops of a new motion closed; its forces are evaluated last all the same.
    """

    kind = "loops"
    order = ForceOrder.BILATERAL

    def __init__(self, scene: Scene, others: Sequence[ForceSource] = (), *, rubs: bool = False) -> None:
        """Initialise with the equality constraints of the system, and no closed latch.

        Args:
            scene: The logged system and its data.
            others: All other contact models that exert forces.
            rubs: Whether dry friction may keep coordinates at rest. It is then always active: they come to rest and begin to
                move where the efforts change, too, without an event.
        """
        super().__init__(scene)
        equalities = equalities_of(scene.system.mj)
        self.equalities: tuple[RowSource, ...] = tuple(equality.source for equality in equalities)
        if equalities:
            signals = [load_signals(scene.system.mj, equality) for equality in equalities]
            self._loads = LoadSample(np.array([len(group) for group in signals]), others)
            every = tuple(signal for group in signals for signal in group)
            self.columns = (Columns(every, self._loads.values, None, self._loads, None, self._loads_now),)
        self._projection = StateProjection(scene, "loops")
        self.columns = (*self.columns, *self._projection.columns)
        self._latches: dict[str, LatchedBodies] = {}
        self._resting: tuple[RowSource, ...] = ()
        self._rubs = rubs
        self._others = tuple(others)
        self._exchanged = LoopExchange(scene)
        self._projected: Exchange | None = None
        self._known: _LoopState | None = None

    @property
    def closed(self) -> tuple[str, ...]:
        """Names of the closed latches, in the order in which they closed."""
        return tuple(self._latches)

    def bind(self, motion: Motion) -> None:
        """Use another motion: the latches stay closed."""
        if hasattr(self, "motion"):
            self.motion.loops = None
        super().bind(motion)
        self._smooth, self._known = Smooth(motion, self.scene.data), None
        if self.equalities:
            self._loads.bind(self._smooth)
        self._update()

    def _update(self) -> None:
        """Let the motion know the rows; nothing is chosen yet of what depends on the state."""
        motion, sources = self.motion, (*self.equalities, *self._latches.values())
        latches = [source for source in sources if isinstance(source, LatchedBodies)]
        motion.disabled = rigid_pairs(self.scene.system.mj, motion, latches)
        # Dry friction makes a row of a coordinate that comes to rest, in any step and without an event of this source.
        self.active, self._projected = bool(sources) or self._rubs, None
        self._exchanged.bind(motion, sources)
        motion.rubs = self._rubs
        self._hold()

    def _hold(self) -> None:
        """Let the motion hold the rows."""
        motion, sources, self._known = self.motion, (*self.equalities, *self._latches.values()), None
        motion.loops = None
        if sources or self._resting:
            motion.loops = ClosedLoops(
                motion.model,
                motion.data,
                sources,
                bodies=motion.bodies,
                dofs=motion.dofs,
                seen=self.scene.data,
                # Numbers in model files are rounded, so rows that depend on each other do so to 1e-8 only (tolerances.py).
                rank=MECHANISM_RANK if self.equalities else RANK,
                resting=self._resting,
            )

    def keep_at_rest(self, coordinates: Sequence[RowSource]) -> None:
        """Keep some coordinates at rest, by their dry friction, and no others."""
        # New rows begin without what was chosen of the old ones, and the factor of all rows is lost: only where they change.
        if tuple(coordinates) != self._resting:
            self._resting = tuple(coordinates)
            if hasattr(self, "motion"):
                self._hold()

    def close(self, name: str, latch: LatchedBodies) -> LoopClosing:
        """Close a latch at the state in ``data``, by a plastic impulse on it and on the latches closed before.

        The velocities of the motion are set, and the logged system follows. The result does not depend on the order in which
        latches close at one instant. The effect of the event must name the motion, the same one: it is bound again, as pairs
        of geoms on rigidly latched bodies are not in contact any more.

        Args:
            name: Its name.
            latch: The latch, between bodies of the logged system; see
                :func:`~ffsm_mj.contact_models.grasp.loops.loop_latch`.
        """
        motion, loops = self.motion, self.motion.loops
        # Rank before: what it grows by is the number of relative motions that the new latch can stop.
        rank = loops.weighted().rank if loops is not None else 0
        self._latches[name] = latch
        self._update()
        assert motion.loops is not None
        # On the rows of all latches at once: an impulse on the new one alone would set the closed ones in motion.
        plastic = motion.loops.plastic()
        wrenches = {latched: self._wrench(self._index_of(latched), plastic.impulses) for latched in self._latches}
        motion.data.qvel[:] += plastic.change
        mujoco.mj_forward(motion.model, motion.data)
        motion.path.on_event_located()
        left = motion.model.nv - plastic.rank
        return LoopClosing(
            wrenches, plastic.change, plastic.loss_J, plastic.rank - rank, latch.count, plastic.least_ratio, left
        )

    def open(self, name: str) -> None:
        """Open a latch; velocities are continuous. No effect if it is not closed. The motion must be bound again."""
        if self._latches.pop(name, None) is not None:
            self._update()

    def set_closed(self, latches: Mapping[str, LatchedBodies] | Iterable[tuple[str, LatchedBodies]]) -> None:
        """Set the closed latches without an impulse: a log replay begins here. The motion must be bound again."""
        self._latches = dict(latches)
        if hasattr(self, "motion"):
            self._update()

    @dataclass
    class State:
        """Which combinations of the rows are independent, None without rows, and projections."""

        combinations: Any
        projection: Any

    def get_state(self) -> State:
        """The combinations; the grasp model closes the latches."""
        combinations = None if self.motion.loops is None else self.motion.loops.get_state()
        return self.State(combinations, self._projection.get_state())

    def set_state(self, state: Any) -> None:
        """Use these combinations."""
        values = entries(state, ("combinations", "projection"), "LoopForces")
        if self.motion.loops is not None:
            self.motion.loops.set_state(values["combinations"])
        self._projection.set_state(values["projection"])

    def names(self) -> str:
        """The closed latches."""
        return ", ".join(self._latches) or self.kind

    def _index_of(self, name: str) -> int:
        """Index of a latch among the sources of rows."""
        return len(self.equalities) + [*self._latches].index(name)

    def restart(self) -> None:
        """Discard the forces of the last step: the state or the efforts changed discontinuously."""
        self._exchanged.clear()

    def begin_step(self, left_s: float, *, continues: bool = False) -> float:
        """Start a (sub-)step: project out drift, and find which rows are independent, unless it continues one."""
        self._projected, loops = None, self.motion.loops
        self._exchanged.clear()
        if continues or loops is None:
            return left_s
        loops.begin_step()
        # Rows are held as accelerations: positions and rates drift by rounding and truncation (Hairer & Wanner, sec. VII.2).
        if needs_projection(*loops.drift(), 0.0):
            nv = self.motion.model.nv
            displaced, outside = self._exchanged.to_fixed_bodies, self._exchanged.outside
            self._projected = self._projection.apply(self.motion, lambda: no_contacts(nv), displaced, outside)
        return left_s

    def begin_steady_steps(self) -> SteadyLoops | None:
        """Rows that exchange nothing between the subsystems, in explicit steps; see :class:`ForceSource`."""
        loops = self.motion.loops
        # The core adds no exchange to the balance, and takes explicit steps only.
        if loops is None or self._exchanged.crosses or self.motion.stiff is not None:
            return None
        self._projected = None
        self._exchanged.clear()
        return SteadyLoops(loops.evaluated())

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores which rows are independent, and which coordinates are at rest."""
        motion, loops, resting = self.motion, self.motion.loops, self._resting
        combinations = loops.snapshot() if loops is not None else None

        def restore() -> None:
            motion.loops, self._resting, self._known = loops, resting, None
            if combinations is not None:
                combinations()

        return restore

    def push(self, data: Any) -> None:
        """Add the forces of the latches under all forces in ``data`` of the motion."""
        loops, applied = self.motion.loops, data.qfrc_applied
        if loops is None:
            return
        # Within one subsystem rows exchange nothing, and the stages need not be kept.
        if not self._exchanged.crosses:
            loops.push()
            return
        # What the rows add is the difference: all forces before them are in the same array.
        others = applied.copy()
        loops.push()
        self._exchanged.add_stage(loops.forces, applied - others)

    def end_step(self, duration_s: float, *, trial: bool = False) -> Exchange | None:
        """Energy and momentum that the latches exchange between the subsystems.

        Raises:
            RunEnded: The mechanism was singular within the step.
        """
        if self.motion.loops is not None and not trial:
            self.motion.loops.end_step()
        return self._exchanged.over(duration_s, self._projected)

    def wrenches(self, data: Any) -> Sequence[Wrench]:  # noqa: ARG002
        """Forces of the latches, those of equality constraints included, on both bodies under the efforts in ``data``.

        Couplings of joints and tendons act as efforts do: between links.
        """
        loops, pairwise = self.motion.loops, list[Wrench]()
        if loops is not None:
            for i, (point, force, torque) in self._under_efforts().wrenches.items():
                latch = loops.sources[i]
                assert isinstance(latch, LatchedBodies)
                pairwise += [
                    Wrench(latch.first, point, -force, -torque, "grasp"),
                    Wrench(latch.second, point, force, torque, "grasp"),
                ]
        return pairwise

    def add_forces(self, applied: FloatArray) -> None:
        """Add the generalised forces of the latches under the efforts in ``data``."""
        if self.motion.loops is not None:
            # At a row of the log efforts are those of the next step, decided after the last stage was evaluated.
            applied += self._under_efforts().generalised

    def _under_efforts(self) -> _LoopState:
        """Forces of the latches at the state in ``data`` under its efforts."""
        loops, applied, smooth = self.motion.loops, np.zeros(self.motion.model.nv), self._smooth
        assert loops is not None
        for other in self._others:
            # Rows answer all other forces: what these add must be known first.
            if other.active:
                other.add_forces(applied)
        kinematics, load, known = smooth.kinematics(), smooth.load(applied), self._known
        # A row of the log asks for several loads at one state: the forces are solved once, for tokens of state and forces.
        if known is None or known.kinematics is not kinematics or known.load is not load:
            generalised = loops.generalised(smooth.force(applied))
            forces = loops.forces
            latches = [i for i, source in enumerate(loops.sources) if isinstance(source, LatchedBodies)]
            wrenches = {i: loops.wrench(i, forces) for i in latches}
            known = self._known = _LoopState(kinematics, load, forces, generalised, wrenches)
        return known

    def _loads_now(self) -> FloatArray:
        """Loads of the equality constraints at the state in ``data`` under its efforts."""
        self._loads(float(self.scene.data.time))
        return self._loads.values.copy()

    def load(self, name: str) -> FloatArray:
        """Force in N, and torque about the object's site in N m, of a latch on the object, world axes, (6,).

        Under the efforts in ``data``; of least norm where rows depend on each other, see :meth:`is_unique`.

        Raises:
            ValueError: No such latch is closed.
        """
        return np.concatenate(self._under_efforts().wrenches[self._index_of(name)][1:])

    def is_unique(self) -> bool:
        """Whether the loads of grasps follow from the motion: no row of a latch depends on others."""
        loops = self.motion.loops
        if loops is None or not self._latches:
            return True
        of_grasps = loops.parts[len(self.equalities)].start
        # A combination of rows that vanishes may change all forces in it by any amount. One of rows of equality constraints
        # alone, as in every planar linkage, leaves the loads of grasps unique.
        return not np.any(np.abs(loops.weighted().independent()[1][:, of_grasps:]) > _TAKES_PART)

    def _wrench(self, which: int, forces: FloatArray) -> FloatArray:
        assert self.motion.loops is not None
        return np.concatenate(self.motion.loops.wrench(which, forces)[1:])


_AT_ROW = "under the efforts of this row; of least norm where the rows of constraints depend on each other"


def load_signals(model: Any, equality: Equality) -> tuple[Signal, ...]:
    """Signals of the load of a constraint: force, of a weld torque too, or the force along the one row of a coupling."""
    name = str(model.equality(equality.id).name)
    start, kind = identifier(name), mujoco.mjtEq(model.eq_type[equality.id])
    if isinstance(equality.source, LatchedBodies):
        second = model.body(equality.source.second).name
        forces = [(f"force_{x}_N", "N", f"force of {name} on {second}, world axes") for x in "xyz"]
        torques = [(f"torque_{x}_N_m", "N m", f"torque of {name} on {second} about its point, world axes") for x in "xyz"]
        columns = forces + (torques if kind == mujoco.mjtEq.mjEQ_WELD else [])
    else:
        joint = int(model.eq_obj1id[equality.id])
        # The force of a coupling is in the unit of the coordinate that follows: N m on a hinge, N on a slide or along a
        # tendon.
        turns = kind == mujoco.mjtEq.mjEQ_JOINT and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
        follower = (model.joint if kind == mujoco.mjtEq.mjEQ_JOINT else model.tendon)(joint).name
        size, unit = ("torque_N_m", "N m") if turns else ("force_N", "N")
        columns = [(size, unit, f"{size.partition('_')[0]} of {name} on {follower}")]
    return tuple(Signal("contact", f"{start}_{key}", unit, f"{what}, {_AT_ROW}", name) for key, unit, what in columns)
