"""Near miss of a grasp: it is disarmed without ever having satisfied its bounds."""

from __future__ import annotations

from ffsm_mj.contact_models.event import EventTime, Scene
from ffsm_mj.contact_models.grasp.closing import state_fields
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.nearness import Nearness
from ffsm_mj.contact_models.grasp.record import NearMissRecord


def near_miss(scene: Scene, latch: Latch, near: Nearness, at_s: float, instant: EventTime) -> NearMissRecord:
    """The record of a near miss, at the state in ``data``.

    Args:
        scene: The logged system and its data.
        latch: The latch that was disarmed; it has bounds.
        near: Distances and speeds at its closest approach.
        at_s: Time of the closest approach, s.
        instant: Time and step at which it was disarmed.
    """
    bounds = latch.stated_bounds
    failed = max(bounds, key=lambda name: getattr(near, name) / bounds[name])
    return NearMissRecord(
        event=scene.numbers.next_number(),
        grasp=latch.grasp.name,
        time_s=instant.time_s,
        step=instant.step,
        least_ratio=latch.ratio(near),
        least_s=at_s,
        **near._asdict(),
        bounds={name: (bound,) for name, bound in bounds.items()},
        failed=failed,
        failed_value=getattr(near, failed),
        failed_bound=bounds[failed],
        **state_fields(scene, scene.data.qvel),
    )
