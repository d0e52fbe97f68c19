"""Impulses that an event exerts on bodies, from its records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from ffsm_mj.contact_models.grasp.record import CaptureRecord
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.wrench import Wrench


def event_impulses(model: Any, records: Iterable[Any]) -> Iterator[Wrench]:
    """Impulses of contacts and grasps on the bodies of a model, in N s and N m s."""
    for record in records:
        if isinstance(record, ImpactRecord):
            impulse = record.impulse_N_s * np.array(record.normal) + np.array(record.tangential_impulse_N_s)
            bodies = [int(model.geom(name).bodyid[0]) for name in record.geoms]
            yield from _pair(bodies, np.array(record.point_m), impulse, np.zeros(3))
        elif isinstance(record, CaptureRecord):
            bodies = [int(model.site(name).bodyid[0]) for name in (record.robot_site, record.object_site)]
            angular = np.array(record.angular_impulse_N_m_s)
            yield from _pair(bodies, np.array(record.point_m), np.array(record.impulse_N_s), angular)


def _pair(bodies: list[int], point: Any, impulse: Any, angular: Any) -> Iterator[Wrench]:
    """Equal and opposite impulses on two bodies; the second takes the positive one."""
    yield Wrench(bodies[0], point, -impulse, -angular)
    yield Wrench(bodies[1], point, impulse, angular)
