"""A force on a body, and a persistent contact as shown to a control law."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, overload

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import ControllerError

_NO_TORQUE = np.zeros(3)


class Wrench(NamedTuple):
    """What acts on a body at a point, in world axes.

    Attributes:
        body: Id of the body.
        point: Where the force acts, m, (3,).
        force: N, (3,).
        torque: N m, beside the moment of the force, (3,).
        by: What exerts it; what a contact model of a plug-in does counts as a contact.
    """

    body: int
    point: FloatArray
    force: FloatArray
    torque: FloatArray = _NO_TORQUE
    by: Literal["contact", "grasp", "field"] = "contact"


_NONE = np.zeros(3)
_NONE.flags.writeable = False


class ActiveContact(NamedTuple):
    """A closed pair of geoms, under the efforts held when the control law is evaluated.

    Attributes:
        pair: Name of the pair in the scenario, or the names of its geoms.
        force_N: Resultant force on the second geom in world axes, N, (3,); may be zero in a closed contact.
        point_m: Centre of pressure, or without force the centre of the contact points, in world axes, m, (3,).
        normal: Mean unit normal from the first geom to the second in world axes, (3,).
        mode: ``closed`` without force, ``pressing`` without friction, ``sticking``, or ``sliding`` at one or more points.
        friction_N: Tangential part of the resultant force on the second geom in world axes, N, (3,).
        slip_m_s: Slip velocity of the second geom relative to the first in world axes, at the contact point that slides
            fastest, m/s, (3,).
        friction_use: Share of the friction limit, mu times the normal force, that is used, in [0, 1]: 1 while a point
            slides; while the pair sticks, it would also stick with mu times this share.
    """

    pair: str
    force_N: FloatArray
    point_m: FloatArray
    normal: FloatArray
    mode: str = "pressing"
    friction_N: FloatArray = _NONE
    slip_m_s: FloatArray = _NONE
    friction_use: float = 0.0


class ActiveContacts(Sequence[ActiveContact]):
    """Closed pairs as a control law sees them, computed when they are first read: most laws do not read them."""

    def __init__(self, compute: Callable[[], tuple[ActiveContact, ...]]) -> None:
        """Store the function that computes the contacts at the present state."""
        self._compute: Callable[[], tuple[ActiveContact, ...]] | None = compute
        self._active: tuple[ActiveContact, ...] | None = None

    def active(self) -> tuple[ActiveContact, ...]:
        """Compute the contacts, if they are not known yet.

        Raises:
            ControllerError: They are those of the past, and were not read then.
        """
        if self._active is None:
            if self._compute is None:
                raise ControllerError(
                    "contacts of an earlier observation were not read then: keep tuple(observation.contacts)"
                )
            self._active = self._compute()
        return self._active

    def expire(self) -> None:
        """The state or the efforts change: contacts that were not read are not known any more."""
        self._compute = None

    def __len__(self) -> int:
        """Number of closed pairs."""
        return len(self.active())

    @overload
    def __getitem__(self, index: int) -> ActiveContact: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[ActiveContact, ...]: ...

    def __getitem__(self, index: int | slice) -> ActiveContact | tuple[ActiveContact, ...]:
        """One or several of them."""
        return self.active()[index]

    def __repr__(self) -> str:
        """The contacts as a tuple."""
        return repr(self.active())
