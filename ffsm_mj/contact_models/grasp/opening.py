"""Opening of a grasp: its record; no impulse acts."""

from __future__ import annotations

import mujoco

from ffsm_mj.contact_models.event import EventTime, Scene, event_fields
from ffsm_mj.contact_models.grasp.closing import as_tuple
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.record import ReleaseRecord


def open_grasp(
    scene: Scene, latch: Latch, instant: EventTime, reason: str, force_N: float, torque_N_m: float
) -> ReleaseRecord:
    """Compute the derived quantities at the state in ``data`` and record the release; velocities are continuous.

    Args:
        scene: The logged system and its data.
        latch: The latch that opens.
        instant: Time and step of the event.
        reason: ``request`` or ``load_limit``.
        force_N: Force on the object right before, N; 0 for a request.
        torque_N_m: Torque on the object about its site right before, N m; 0 for a request.
    """
    mujoco.mj_forward(scene.system.mj, scene.data)
    point = as_tuple(latch.sites.point(scene.data))
    return ReleaseRecord(
        grasp=latch.grasp.name,
        point_m=point,
        reason=reason,
        force_N=force_N,
        torque_N_m=torque_N_m,
        **event_fields(scene, instant, scene.data.qvel),
    )
