"""Who takes over the pairs that an impact leaves closed and still."""

from __future__ import annotations

from typing import Protocol

from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.impact.touching import Touching


class PersistentContacts(Protocol):
    """Holds pairs while they stay closed; what it holds is no business of the detection of touches."""

    def holds(self, pair: ContactPair) -> bool:
        """Whether it holds this pair now."""

    def refusal(self, pair: ContactPair) -> str:
        """Why it cannot hold a pair; empty where it can."""

    def close(self, touching: Touching) -> None:
        """Take over what is closed and still of the pairs in contact, at the velocities in ``data``, and nothing else."""


class NoPersistentContacts:
    """Leaves everything to the detection of touches."""

    def holds(self, _: ContactPair) -> bool:
        """It holds none."""
        return False

    def refusal(self, _: ContactPair) -> str:
        """It can hold none."""
        return "nothing holds it"

    def close(self, _: Touching) -> None:
        """It takes none."""
