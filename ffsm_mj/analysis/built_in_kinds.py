"""Kinds of the records of every run and of grasps, in the order of ``summary.json``."""

from __future__ import annotations

from ffsm_mj.contact.unhandled_record import UNHANDLED_CONTACT
from ffsm_mj.contact_models.grasp.record_kinds import KINDS as CAPTURES
from ffsm_mj.contact_models.impact.limit_record import LIMIT_IMPACT
from ffsm_mj.contact_models.impact.record_kind import IMPACT
from ffsm_mj.contact_models.persistent.record import (
    CONTACT_BEGINS,
    CONTACT_CHANGES,
    CONTACT_ENDS,
    FRICTION_KINDS,
    LIMIT_KINDS,
)
from ffsm_mj.records.effort_change import EFFORT_CHANGE
from ffsm_mj.records.run_kinds import INTERNAL_ERROR, OUTCOME, PHASE

IN_EVERY_RUN = (IMPACT, CONTACT_BEGINS, CONTACT_ENDS, CONTACT_CHANGES, UNHANDLED_CONTACT, PHASE, INTERNAL_ERROR, OUTCOME)

LIMITS = (LIMIT_IMPACT, *LIMIT_KINDS)
"""Kinds of runs with joint limits."""

BUILT_IN = (*IN_EVERY_RUN, *FRICTION_KINDS, *LIMITS, EFFORT_CHANGE, *CAPTURES)
"""The last ones belong to runs whose scenario declares grasps."""
