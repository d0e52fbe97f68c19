"""Events in words, for the people who look at a recording."""

from __future__ import annotations

from ffsm_mj.records.events import Event, ImpactRecord, Outcome, OutcomeRecord, PhaseRecord


def event_time(event: Event | OutcomeRecord) -> float:
    """When an event is logged, s: an overlap at its end, when its depth is known."""
    if isinstance(event, ImpactRecord):
        return event.time_s
    return event.start_s if isinstance(event, PhaseRecord) else event.end_s


def sentence(event: Event | OutcomeRecord) -> str:
    """What happened, in one line."""
    if isinstance(event, ImpactRecord):
        pair = f"{' on '.join(event.geoms)}, e = {event.restitution:g}"
        speeds = f"approach {event.approach_speed_m_s:.4g} m/s, separation {event.separation_speed_m_s:.4g} m/s"
        return f"impact of {event.pair}: {event.impulse_N_s:.5g} N s, {pair}, {speeds}"
    if isinstance(event, PhaseRecord):
        return f"phase {event.name} ({event.controller}) begins: {event.reason}"
    if isinstance(event, OutcomeRecord):
        return f"{event.outcome}: {event.message}" if event.message else event.outcome
    geoms, lasted = " and ".join(event.geoms), f"from {event.start_s:.3f} to {event.end_s:.3f} s"
    return f"unhandled contact: {geoms} overlapped {lasted}, up to {event.max_depth_m:.3g} m deep"


def is_warning(event: Event | OutcomeRecord) -> bool:
    """Whether it is something that the user of the scenario should look into."""
    if isinstance(event, OutcomeRecord):
        return event.outcome != Outcome.COMPLETED
    return not isinstance(event, ImpactRecord | PhaseRecord)
