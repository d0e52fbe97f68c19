"""Record kind of unhandled contacts; :mod:`.watch` detects them."""

from __future__ import annotations

from ffsm_mj.records.events import UnhandledContactRecord
from ffsm_mj.records.kinds import RecordKind


def _sentence(record: UnhandledContactRecord) -> str:
    geoms, lasted = " and ".join(record.geoms), f"from {record.start_s:.3f} to {record.end_s:.3f} s"
    return f"unhandled contact: {geoms} overlapped {lasted}, up to {record.max_depth_m:.3g} m deep"


UNHANDLED_CONTACT = RecordKind(
    record=UnhandledContactRecord,
    name="unhandled_contact",
    plural="unhandled_contacts",
    when="when an unhandled overlap ends",
    time=lambda record: record.end_s,  # its greatest depth is known only then
    sentence=_sentence,
    warning=lambda _: True,
    in_every_run=True,
)
