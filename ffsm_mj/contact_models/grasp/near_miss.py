"""Near miss of a grasp: it is disarmed without ever having satisfied its bounds."""

from __future__ import annotations

from ffsm_mj.contact_models.event import EventTime, Scene, event_fields
from ffsm_mj.contact_models.grasp.closest_approach import ClosestApproach
from ffsm_mj.contact_models.grasp.record import NearMissRecord


def near_miss(scene: Scene, grasp: str, closest: ClosestApproach, instant: EventTime) -> NearMissRecord | None:
    """The record of a near miss, at the state in ``data``; None if no time has passed since the grasp was armed.

    Args:
        scene: The logged system and its data.
        grasp: Name of the grasp.
        closest: Its closest approach.
        instant: Time and step at which it was disarmed.
    """
    if (first := closest.first()) is None:
        return None
    near, least_s, failed = first
    bounds = closest.bounds.stated
    return NearMissRecord(
        grasp=grasp,
        least_ratio=closest.bounds.ratio(near),
        least_s=least_s,
        **near._asdict(),
        bounds={name: (bound,) for name, bound in bounds.items()},
        failed=failed,
        failed_value=getattr(near, failed),
        failed_bound=bounds[failed],
        **event_fields(scene, instant, scene.data.qvel),
    )
