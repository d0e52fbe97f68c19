"""Shortcut through steady states: all contact points carry force and none slides, as in the state before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.model.system import System

if TYPE_CHECKING:
    from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet


class RuleTables(NamedTuple):
    """Tables of the log columns of contact rules.

    Attributes:
        values: Columns of each rule, see ``rule_columns.py``, (n, columns).
        rows: Row of each rule.
        friction_values: The same of the rules with friction, see ``friction/report.py``.
        friction_rows: Row of each of them.
        work_J: Work of the forces of contacts with friction, (1,).
    """

    values: FloatArray
    rows: dict[str, int]
    friction_values: FloatArray
    friction_rows: dict[str, int]
    work_J: FloatArray


class SteadyContacts:
    """Closed contacts of which all points carry force and none slides, as most of the time.

    Their compiled twin recognises such states and does what follows from them: no contact begins, ends or changes, and the
    forces are those that hold all points. Any other state is left to the choice of the active set and of the modes, which
    gives the same results. In plain Python there is no shortcut: no state counts as steady.

    Attributes:
        lowest: Smallest gap in the state that was found steady last, m.
    """

    lowest = 0.0

    def __init__(self, closed: ActiveContactSet, system: System) -> None:  # noqa: ARG002 (its twin needs the system)
        """Store the closed contacts of a system."""
        self._closed = closed

    def report_to(self, tables: RuleTables) -> None:
        """Set the tables of :meth:`write` and :meth:`exchange`."""

    def is_now(self) -> bool:
        """Whether the state in ``data`` under its efforts is steady: nothing changes, and no gap has drifted too far."""
        return False

    def goes_on(self) -> bool:
        """Begin a step with the contacts and modes of the step before, if the state is steady; returns whether it is.

        False where drift must be projected out.
        """
        return False

    def write(self) -> bool:
        """Write the columns of all contact rules, if the state is steady; returns whether it is."""
        return False

    def push(self, data: Any) -> None:
        """Add the contact forces to ``data.qfrc_applied``, which holds all other applied forces."""
        self._closed.push(data)

    def exchange(self, duration_s: float) -> Exchange | None:  # noqa: ARG002
        """Energy and momentum exchanged in a (sub-)step, if the state at its end is steady; adds impulses and work."""
        return None
