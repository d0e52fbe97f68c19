"""What the link puts on the object that it holds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, numbers
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.interface import ContactModel
from ffsm_mj.dynamics.rigid_body import cross

_AFTER_VELOCITIES = int(mujoco.mjtStage.mjSTAGE_VEL)
_NUMBERS = 19
_NONE = bytes(8 * _NUMBERS)
_ALONE = np.zeros(6)
_NO_EVENT = 0.0, 0.0, math.nan


class InterfaceLoad:
    """Force on the object and its torque about its site: Newton and Euler of all its bodies, less what others put on them.

    MuJoCo's numbers are asked for at a state; what they come to is worked out for many at once.
    """

    def __init__(
        self, number: int, held: GraspedMotion, site: FloatArray, seen: Any, others: Sequence[ContactModel] = ()
    ) -> None:
        """Bind to what moves.

        Args:
            number: Of the grasp.
            held: What moves.
            site: Where the object's site is, world axes, m: a live array, (3,).
            seen: Data of the system that is logged.
            others: Who may push what moves besides the efforts: contacts that last, springs.
        """
        self._model, self._data, self._take_efforts = held.model, held.data, held.take_efforts
        self._held, self._site, self._seen, self._others = held, site, seen, tuple(others)
        # Torque about the mass centre of the whole tree and force, that centre, the site.
        self._raw = held.interface, held.centre, site
        self._number, self._views = np.array([number], dtype=np.float64).tobytes(), [numbers(part) for part in self._raw]

    def _refresh(self) -> FloatArray:
        """Ask MuJoCo at the state of what moves, under the system's efforts; gives what others put on the object."""
        self._take_efforts()
        of_others = _ALONE
        for contact_model in self._others:
            if contact_model.active and contact_model.pushes:
                of_others = self._pushed()
                break
        mujoco.mj_forwardSkip(self._model, self._data, _AFTER_VELOCITIES, 1)
        mujoco.mj_rnePostConstraint(self._model, self._data)
        return of_others

    def _pushed(self) -> FloatArray:
        """Let who pushes do so, and nobody else; gives their force on the object, and its torque about the site.

        What answers the efforts does so anew, by its wrenches: its last push was for the efforts of before.
        """
        held, applied, carried, on_object = self._held, self._data.qfrc_applied, self._held.carried_bodies, np.zeros(6)
        applied.fill(0.0)
        for contact_model in [each for each in self._others if each.active and each.pushes]:
            wrenches = contact_model.wrenches(self._seen)
            if contact_model.is_reactive:
                for body, point, force, torque in wrenches:
                    mujoco.mj_applyFT(self._model, self._data, force, torque, point, held.bodies[body], applied)
            else:
                contact_model.push(self._data)
            for body, point, force, torque in wrenches:
                if body in carried:
                    on_object[:3] += force
                    on_object[3:] += torque + cross(point - self._site, force)
        return on_object

    def now(self) -> FloatArray:
        """Force in N and torque in N m, world axes, (6,)."""
        of_others = self._refresh()
        return np.asarray(_loads(np.concatenate((*self._raw, of_others))[None])[0])

    def raw(self) -> bytes:
        """Number of the grasp, what MuJoCo says now, what others put on the object: the numbers of a row of notes."""
        of_others = self._refresh()
        interface, centre, site = self._views
        return self._number + interface.tobytes() + centre.tobytes() + site.tobytes() + of_others.tobytes()


class LoadBuffer:
    """Numbers of the grasps that hold, and loads, at some rows, and the greatest right after events between them.

    Attributes:
        between: Greatest force in N and torque in N m right after an event since the last row, and when that force was in s.
    """

    def __init__(self) -> None:
        """Nothing is noted yet."""
        self._kept: list[bytes] = []
        self._between: list[tuple[float, float, float]] = []
        self.between = _NO_EVENT

    def after_event(self, load: InterfaceLoad, time_s: float) -> None:
        """An event is over, and what acts from here on is decided."""
        force, torque = (math.hypot(*part.tolist()) for part in np.split(load.now(), 2))
        greatest, turning, at_s = self.between
        self.between = max(force, greatest), max(torque, turning), at_s if force <= greatest else time_s

    def note(self, load: InterfaceLoad | None) -> None:
        """Keep the next row; None: nothing is held."""
        self._kept.append(load.raw() if load is not None else _NONE)
        self._between.append(self.between)
        self.between = _NO_EVENT

    def table(self) -> FloatArray:
        """Number, force, torque, site (none where nothing is held), what was between: rows since the last table, (n, 13)."""
        rows, between = np.frombuffer(b"".join(self._kept)).reshape(-1, _NUMBERS), np.array(self._between)
        self._kept.clear()
        self._between.clear()
        number, site = rows[:, :1], np.where(rows[:, :1] > 0.0, rows[:, 10:13], np.nan)
        return np.concatenate((number, _loads(rows[:, 1:]), site, between.reshape(-1, 3)), axis=1)


def _loads(raw: FloatArray) -> FloatArray:
    """Forces and torques about the site, (n, 6).

    Args:
        raw: Torques and forces about a centre, that centre, the site, what others put on the object as a result, (n, 18).
    """
    torque, force, centre, site = np.split(raw[:, :12], 4, axis=1)
    return np.concatenate((force, torque + np.cross(centre - site, force)), axis=1) - raw[:, 12:]
