"""Contact models that a scenario may declare, registered ones and those of installed packages, and the built-in records.

Importing this module registers the kinds of records of every run and of the built-in contact models, in the order of logs
and summaries; those of another contact model are registered with it.
"""

from __future__ import annotations

from importlib.metadata import entry_points

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
from ffsm_mj.errors import described, unknown_name
from ffsm_mj.records import kinds
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.run_kinds import EFFORT_CHANGE, INTERNAL_ERROR, OUTCOME, PHASE

GROUP = "ffsm_mj.contact_models"
BUILT_IN_KINDS = ("impact", "contact", "grasp")
"""Kinds of the built-in contact models, which no other may have."""

BUILT_IN_RECORDS = (
    *(IMPACT, CONTACT_BEGINS, CONTACT_ENDS, CONTACT_CHANGES, UNHANDLED_CONTACT, PHASE, INTERNAL_ERROR, OUTCOME),
    *(*FRICTION_KINDS, LIMIT_IMPACT, *LIMIT_KINDS, EFFORT_CHANGE, *GRASP_KINDS, STICK_SLIP),
)
"""Kinds of records of every run, then those of friction, joint limits, delays, grasps and dry friction of joints."""

_REGISTERED: dict[str, type[ContactModel]] = {}
_BROKEN: dict[str, str] = {}

for _kind in BUILT_IN_RECORDS:
    kinds.register(_kind, checked=True)


def register(contact_model: type[ContactModel]) -> type[ContactModel]:
    """Register a contact model by its kind.

    Raises:
        ValueError: Another contact model has the same kind, or it is not one with a source of events or of forces.
    """
    if not (issubclass(contact_model, ContactModel) and issubclass(contact_model, EventSource | ForceSource)):
        raise ValueError(
            f"the contact model {contact_model.kind!r} must be a ContactModel and an EventSource or a ForceSource"
        )
    if contact_model.kind in BUILT_IN_KINDS:
        raise ValueError(f"{contact_model.kind!r} is the kind of a built-in contact model")
    if _REGISTERED.setdefault(contact_model.kind, contact_model) is not contact_model:
        raise ValueError(f"another contact model has the kind {contact_model.kind!r}")
    for kind in contact_model.records if issubclass(contact_model, EventSource) else ():
        kinds.register(kind)
    return contact_model


def contact_models() -> dict[str, type[ContactModel]]:
    """Contact models that a scenario may declare, by kind: registered ones and those of installed packages."""
    for entry_point in entry_points(group=GROUP):
        if entry_point.name in BUILT_IN_KINDS:
            _BROKEN[entry_point.name] = f"{entry_point.value} has the name of a built-in contact model; rename it"
        elif entry_point.name not in _REGISTERED:
            try:
                contact_model = entry_point.load()
                contact_model.Config.model_rebuild()  # now, while what is wrong with it is the package's alone
                register(contact_model)
            except Exception as error:  # noqa: BLE001 (a package may fail in any way: only its contact model is unavailable)
                _BROKEN[entry_point.name] = described(error)
    return dict(_REGISTERED)


def record_kinds_of(kind: str) -> tuple[RecordKind, ...]:
    """Kinds of the records of a contact model, by the model's kind; none if it has no events.

    Raises:
        LookupError: There is no such contact model.
    """
    contact_model = contact_model_of(kind)
    return contact_model.records if issubclass(contact_model, EventSource) else ()


def contact_model_of(kind: str) -> type[ContactModel]:
    """Look up a contact model by kind.

    Raises:
        LookupError: There is none; the message lists the known kinds.
    """
    if registered := _REGISTERED.get(kind):
        return registered  # without the search for packages, which reads metadata of every package there is
    known = contact_models()
    if kind in _BROKEN:
        raise LookupError(f"the contact model {kind!r} of an installed package cannot be used ({_BROKEN[kind]})")
    if not known:
        raise LookupError(f"unknown contact model {kind!r}: no installed package provides one")
    if kind not in known:
        raise LookupError(unknown_name("contact model", kind, known))
    return known[kind]
