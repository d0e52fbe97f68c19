"""A linear spring between two geoms while they overlap: a contact that lasts many steps."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field, PositiveFloat
from scipy.optimize import brentq

from ffsm_mj.config import StrictModel
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.interface import ContactModel, EventEffect, EventSource, ForceSource, Replayable
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.contact_forces import Wrench
from ffsm_mj.records.events import QPOS, QVEL, QVEL_UNCHANGED, STEP
from ffsm_mj.records.kinds import Mark, RecordKind
from ffsm_mj.records.record import ByName, Values, declared, record
from ffsm_mj.records.signals import Signal

_FAR = 1e3


class SpringConfig(StrictModel):
    """A spring between two geoms."""

    kind: Literal["spring"]
    geoms: tuple[str, ...] = Field(min_length=2, max_length=2)
    stiffness_N_m: PositiveFloat
    """Force per depth of overlap, N/m."""


@record
class SpringRecord:
    """The spring begins or ceases to push."""

    time_s: float = declared("Simulation time.")
    step: int = declared(STEP)
    pushing: int = declared("1 from here on, or 0.")
    point_m: Values = declared("A witness point.", column=False, components="xyz")
    normal: Values = declared("Unit normal.", column=False, components="xyz")
    qpos: Values = declared(QPOS)
    qvel_before: ByName = declared(QVEL)
    qvel_after: ByName = declared(QVEL_UNCHANGED)
    efforts_after: ByName = declared("Effort by actuator after the event.", default_factory=dict)


SPRING = RecordKind(
    record=SpringRecord,
    name="spring",
    plural="springs",
    when="when it begins or ceases to push",
    time=lambda record: record.time_s,
    sentence=lambda record: f"the spring {'begins' if record.pushing else 'ceases'} to push",
    marks=lambda record: [Mark(record.point_m, record.normal, 0.1, "spring")],
)


class Spring(ContactModel, EventSource, ForceSource, Replayable):
    """Pushes while two geoms overlap, in proportion to how deep."""

    kind = "spring"
    Config = SpringConfig
    records = (SPRING,)
    event_bound = -math.inf  # evaluated at every step

    def __init__(self, config, scene):
        super().__init__(config, scene)
        self._model, self._stiffness = scene.system.mj, config.stiffness_N_m
        self._pair = ContactPair(scene.system, "spring", *config.geoms, 0.0)
        self.watched = frozenset((self._pair.geom_ids,))
        self._force = np.zeros(1)
        signal = Signal("contact", "spring_force_N", "N", "force of the spring")
        self.columns = (Columns((signal,), live=self._force, on_sample=self._note),)

    def is_clear(self):
        return (self._gap() < 0.0) == self.active

    def first_event(self, duration_s):
        def gap(time_s):
            self.motion.path.move_to(time_s)
            return self._gap()

        start, end = gap(0.0), gap(duration_s)
        if (end < 0.0) == self.active:
            return None
        return float(brentq(gap, 0.0, duration_s, xtol=1e-15)) if start * end < 0.0 else 0.0

    def act(self, instant):
        self.active = not self.active
        system, data = self.scene.system, self.scene.data
        near = self._pair.proximity(self._model, data)
        rates = system.by_joint(data.qvel)
        place = tuple(near.points[0].tolist()), tuple(near.normal.tolist()), tuple(data.qpos.tolist())
        return EventEffect((SpringRecord(instant.time_s, instant.step, int(self.active), *place, rates, rates),))

    def wrenches(self, data):
        near = self._pair.proximity(self._model, data)
        force = -self._stiffness * near.gap * near.normal
        return Wrench(self._pair.body_a, near.points[0], -force), Wrench(self._pair.body_b, near.points[0], force)

    def restore_state(self, events=()):
        self.active = self._gap() < 0.0

    def _gap(self):
        return self._pair.gap(self._model, self.scene.data, _FAR)

    def _note(self, _):
        self._force[0] = -self._stiffness * self._gap() if self.active else 0.0
