"""The kinds of records of every run and of captures, registered in the order of ``summary.json``; importing this is enough.

Every run and every log that is read passes through :mod:`.run`, which does: here alone floors above and below the log meet.
"""

from __future__ import annotations

from ffsm_mj.contact.unhandled import UNHANDLED_CONTACT
from ffsm_mj.contact_models.grasp.record import KINDS as CAPTURES
from ffsm_mj.contact_models.impact.record_kind import IMPACT
from ffsm_mj.contact_models.persistent.record import CONTACT_BEGINS, CONTACT_CHANGES, CONTACT_ENDS
from ffsm_mj.records.kinds import register
from ffsm_mj.records.run_kinds import INTERNAL_ERROR, OUTCOME, PHASE

IN_EVERY_RUN = (IMPACT, CONTACT_BEGINS, CONTACT_ENDS, CONTACT_CHANGES, UNHANDLED_CONTACT, PHASE, INTERNAL_ERROR, OUTCOME)

DECLARED = CAPTURES
"""Of runs whose scenario declares what leaves them."""

for kind in (*IN_EVERY_RUN, *DECLARED):
    register(kind)
