"""Data common to the figures of one run: its model, paths in space, and the roles of joints and actuators."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log, logged_scenario
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.system import Joint
from ffsm_mj.records.kinds import Mark, RecordKind
from ffsm_mj.records.signals import effort_key, identifier
from ffsm_mj.report.plots.silhouette import Plane, Silhouette
from ffsm_mj.report.plots.style import TIP_AFTER, TIP_BEFORE
from ffsm_mj.report.plots.thinning import thinned

_POSES = 1500
_PLANES = (Plane(0, 1), Plane(0, 2), Plane(1, 2))


class TipPart(NamedTuple):
    """Part of the path of the tip: name, colour, rows, (n,), and points at these rows, (n, 3), m."""

    label: str
    colour: str
    rows: Any
    points: FloatArray


class Subject:
    """A run and its model, compiled from the log."""

    def __init__(self, run: Run, times: Sequence[float] = ()) -> None:
        """Take a run; a long one is thinned, see :func:`ffsm_mj.report.plots.thinning.thinned`.

        Args:
            run: A run with at least one sample.
            times: Times at which it will be drawn, s.

        Raises:
            InputError: It has no samples, or its models no longer compile.
        """
        if not len(run.log.rows):
            raise InputError(f"{run.path or run.name}: the log has no samples, there is nothing to draw")
        self._place = f"log {run.path}" if run.path else "the log"
        self.run, self.system = thinned(run, times), compile_log(run.log, self._place)
        if not len(self.run.log.rows):
            raise InputError(f"{self._place}: no sample has finite coordinates, there is nothing to draw")
        if self.run.qpos.shape[1] != self.system.mj.nq:
            raise InputError(f"{self._place}: the coordinates of its samples are not those of its models")
        self.silhouette = Silhouette(self.system)

    @cached_property
    def marks(self) -> list[tuple[RecordKind, float, Mark]]:
        """Marks of the records of the run: kind, time in s, and mark."""
        return self.run.log.marks()

    @property
    def first_mark_s(self) -> float:
        """Time of the first mark, if there is one, s."""
        return min(time for _, time, _ in self.marks)

    @cached_property
    def chosen(self) -> Any:
        """Rows at which poses are computed: all of a short run, evenly spaced ones of a long one."""
        count = len(self.run.time)
        return np.unique(np.linspace(0, count - 1, min(count, _POSES)).astype(np.intp))

    @cached_property
    def roots(self) -> dict[str, FloatArray]:
        """Centre of mass of the root body of each tree at the chosen rows, (n, 3), m."""
        paths = {tree.name: np.empty((len(self.chosen), 3)) for tree in self.system.trees}
        for i, qpos in enumerate(self.run.qpos[self.chosen]):
            data = self.silhouette.place(qpos)
            for tree in self.system.trees:
                pose = data.xmat[tree.root].reshape(3, 3)
                paths[tree.name][i] = data.xpos[tree.root] + pose @ self.system.mj.body_ipos[tree.root]
        return paths

    @cached_property
    def tip(self) -> FloatArray | None:
        """Path of the tip at the chosen rows, (n, 3), m; None without a task."""
        return self.run.tip[self.chosen] if "state.tip_x_m" in self.run.keys else None

    @cached_property
    def tip_parts(self) -> tuple[TipPart, ...]:
        """The path of the tip, split at the first mark; empty without a task."""
        if self.tip is None:
            return ()
        if not self.marks:
            return (TipPart("tip", TIP_BEFORE, self.chosen, self.tip),)
        first = int(np.searchsorted(self.run.time[self.chosen], self.first_mark_s - 1e-9))
        before, after = slice(0, first + 1), slice(first, None)  # they share the row of the mark
        return (
            TipPart("tip, before", TIP_BEFORE, self.chosen[before], self.tip[before]),
            TipPart("tip, after", TIP_AFTER, self.chosen[after], self.tip[after]),
        )

    @cached_property
    def planes(self) -> tuple[Plane, ...]:
        """Planes to draw: that of the largest motion, and for motion in space also the next one."""
        paths = [*self.roots.values()] + ([self.tip] if self.tip is not None else [])
        span = np.ptp(np.vstack(paths), axis=0)
        moving = [np.ptp(path, axis=0) for path in paths]
        flat = np.max(moving, axis=0) < 1e-9 * (1.0 + span.max())
        ranked = sorted(_PLANES, key=lambda plane: -span[plane.right] * span[plane.up])
        if flat.any():
            still = int(np.argmax(flat)) if flat.sum() == 1 else 2
            return tuple(plane for plane in ranked if still not in plane.axes)[:1]
        return ranked[0], next(plane for plane in ranked[1:] if plane.right == ranked[0].right or plane.up == ranked[0].up)

    @cached_property
    def _kinds(self) -> dict[str, str]:
        """Kind of each actuator that the scenario limits, by its full name."""
        kinds = logged_scenario(self.run.log, self._place).kinds
        try:
            return {self.system.resolve("actuator", name): kind for name, kind in kinds.items()}
        except LookupError as error:
            raise InputError(f"{self._place}: scenario.yaml: actuators: {error.args[0]}") from error

    def _joint_of(self, actuator: int) -> Joint | None:
        model = self.system.mj
        if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_JOINT:
            return None
        return self.system.joints[model.joint(int(model.actuator_trnid[actuator, 0])).name]

    @cached_property
    def actuators(self) -> dict[str, str]:
        """Role by name: ``thruster`` (a force on the base), ``wheel`` (a torque on it), ``magnetorquer`` or ``motor``."""
        base = self.system.robot.base_dofs
        roles, servos = {}, servo_mask(self.system.mj)
        for i, name in enumerate(self.system.names("actuator")):
            joint = self._joint_of(i)
            force = f"actuators.{identifier(name)}_applied_N" in self.run.keys
            on_base = (joint is None and not servos[i]) or (joint is not None and base.start <= joint.dofs.start < base.stop)
            if self._kinds.get(name) == "magnetorquer":
                roles[name] = "magnetorquer"
            elif self._kinds.get(name) == "reaction_wheel" or (on_base and not force):
                roles[name] = "wheel"
            else:
                roles[name] = "thruster" if on_base else "motor"
        return roles

    def named(self, role: str) -> list[str]:
        """Actuators of a role."""
        return [name for name, its in self.actuators.items() if its == role]

    @property
    def base_actuated(self) -> bool:
        """Whether any thruster, wheel or magnetorquer was active."""
        names, layout = [name for name, role in self.actuators.items() if role != "motor"], self.run.log.header.layout
        return any(np.any(self.run[effort_key(layout, name, "applied")]) for name in names)

    @cached_property
    def wheel_joints(self) -> list[Joint]:
        """Joints of reaction wheels, not those of the base itself."""
        base = self.system.robot.base_dofs
        joints = [self._joint_of(i) for i, name in enumerate(self.actuators) if self.actuators[name] == "wheel"]
        return [joint for joint in joints if joint is not None and not base.start <= joint.dofs.start < base.stop]

    @cached_property
    def arm_joints(self) -> list[Joint]:
        """Joints of one coordinate that are neither the base's nor a wheel's."""
        robot = self.system.robot
        return [
            joint
            for joint in robot.joints
            if joint.kind in ("hinge", "slide") and joint.body != robot.root and joint not in self.wheel_joints
        ]
