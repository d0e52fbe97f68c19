"""Contact models that a scenario may declare, registered ones and those of installed packages, and the built-in records.

Importing this module registers the kinds of records of every run and of the built-in contact models, in the order of logs
and summaries; those of another contact model are registered with it.
"""

from __future__ import annotations

from ffsm_mj.contact.watch import UNHANDLED_CONTACT
from ffsm_mj.contact_models.grasp.records import KINDS as GRASP_KINDS
from ffsm_mj.contact_models.impact.records import IMPACT, LIMIT_IMPACT
from ffsm_mj.contact_models.interface import ContactModel, EventSource, ForceSource
from ffsm_mj.contact_models.joint_friction.record import STICK_SLIP
from ffsm_mj.contact_models.persistent.record import (
    CONTACT_BEGINS,
    CONTACT_CHANGES,
    CONTACT_ENDS,
    FRICTION_KINDS,
    LIMIT_KINDS,
)
from ffsm_mj.plugins import Plugins
from ffsm_mj.records import kinds
from ffsm_mj.records.events import EFFORT_CHANGE, INTERNAL_ERROR, OUTCOME, PHASE
from ffsm_mj.records.kinds import RecordKind

GROUP = "ffsm_mj.contact_models"
BUILT_IN_KINDS = ("impact", "contact", "grasp")
"""Kinds of the built-in contact models, which no other may have."""

BUILT_IN_RECORDS = (
    *(IMPACT, CONTACT_BEGINS, CONTACT_ENDS, CONTACT_CHANGES, UNHANDLED_CONTACT, PHASE, INTERNAL_ERROR, OUTCOME),
    *(*FRICTION_KINDS, LIMIT_IMPACT, *LIMIT_KINDS, EFFORT_CHANGE, *GRASP_KINDS, STICK_SLIP),
)
"""Kinds of records of every run, then those of friction, joint limits, delays, grasps and dry friction of joints."""

for _kind in BUILT_IN_RECORDS:
    kinds.register(_kind, checked=True)


def _check(contact_model: type[ContactModel]) -> None:
    """Refuse what is no contact model."""
    if not (issubclass(contact_model, ContactModel) and issubclass(contact_model, EventSource | ForceSource)):
        raise ValueError(
            f"the contact model {contact_model.kind!r} must be a ContactModel and an EventSource or a ForceSource"
        )


def _register_records(contact_model: type[ContactModel]) -> None:
    for kind in contact_model.records if issubclass(contact_model, EventSource) else ():
        kinds.register(kind)


PLUGINS = Plugins[type[ContactModel]](GROUP, "contact model", _check, built_in=BUILT_IN_KINDS, then=_register_records)
register, contact_models, contact_model_of = PLUGINS.register, PLUGINS.every, PLUGINS.named
"""Registers a contact model; all that a scenario may declare, by kind; one of them."""


def record_kinds_of(kind: str) -> tuple[RecordKind, ...]:
    """Kinds of the records of a contact model, by the model's kind; none if it has no events.

    Raises:
        LookupError: There is no such contact model.
    """
    contact_model = contact_model_of(kind)
    return contact_model.records if issubclass(contact_model, EventSource) else ()
