"""What the link puts on the object that it holds."""

from __future__ import annotations

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, numbers
from ffsm_mj.capture.held import Held

_AFTER_VELOCITIES = int(mujoco.mjtStage.mjSTAGE_VEL)
_NUMBERS = 13
_NONE = bytes(8 * _NUMBERS)


class InterfaceLoad:
    """Force on the object and its torque about its site: Newton and Euler of all its bodies.

    MuJoCo's numbers are asked for at a state; what they come to is worked out for many at once.
    """

    def __init__(self, number: int, held: Held, site: FloatArray) -> None:
        """Bind to what moves.

        Args:
            number: Of the grasp.
            held: What moves.
            site: Where the object's site is, world axes, m: a live array, (3,).
        """
        self._model, self._data, self._take_efforts = held.model, held.data, held.take_efforts
        # Torque about the mass centre of the whole tree and force, that centre, the site.
        self._raw = held.interface, held.centre, site
        self._number, self._views = np.array([number], dtype=np.float64).tobytes(), [numbers(part) for part in self._raw]

    def _refresh(self) -> None:
        """Ask MuJoCo at the state of what moves, under the efforts in the system's data."""
        self._take_efforts()
        mujoco.mj_forwardSkip(self._model, self._data, _AFTER_VELOCITIES, 1)
        mujoco.mj_rnePostConstraint(self._model, self._data)

    def now(self) -> FloatArray:
        """Force in N and torque in N m, world axes, (6,)."""
        self._refresh()
        return np.asarray(_loads(np.concatenate(self._raw)[None])[0])

    def raw(self) -> bytes:
        """The grasp's number, and what MuJoCo says now: as many numbers as a row of notes has."""
        self._refresh()
        interface, centre, site = self._views
        return self._number + interface.tobytes() + centre.tobytes() + site.tobytes()


class LoadNotes:
    """Numbers of the grasps that hold, and loads, at some rows."""

    def __init__(self) -> None:
        """Nothing is noted yet."""
        self._kept: list[bytes] = []

    def note(self, load: InterfaceLoad | None) -> None:
        """Keep the next row; None: nothing is held."""
        self._kept.append(load.raw() if load is not None else _NONE)

    def table(self) -> FloatArray:
        """Number, force and torque at all rows since the last table, (n, 7)."""
        rows = np.frombuffer(b"".join(self._kept)).reshape(-1, _NUMBERS)
        self._kept.clear()
        return np.concatenate((rows[:, :1], _loads(rows[:, 1:])), axis=1)


def _loads(raw: FloatArray) -> FloatArray:
    """Forces and torques about the site, (n, 6), of torques and forces about a centre, that centre and the site, (n, 12)."""
    torque, force, centre, site = np.split(raw, 4, axis=1)
    return np.concatenate((force, torque + np.cross(centre - site, force)), axis=1)
