"""A force on a joint that is a function of time, evaluated in the stages: no motor, held from tick to tick, exerts it."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from ffsm_mj.config import StrictModel
from ffsm_mj.contact_models.interface import ContactModel, ForceSource
from ffsm_mj.records.contact_forces import Wrench


class DriveConfig(StrictModel):
    """A force slope t + amplitude sin(rate t)."""

    kind: Literal["drive"]
    joint: str
    slope: float = 0.0
    amplitude: float = 0.0
    rate_rad_s: float = 0.0


class Drive(ContactModel, ForceSource):
    """Acts on a hinge or slide, with the reaction on the parent body."""

    kind = "drive"
    Config = DriveConfig
    active = True

    def __init__(self, config, scene):
        super().__init__(config, scene)
        model = scene.system.mj
        self._config, self._joint = config, model.joint(scene.system.resolve("joint", config.joint))
        self._body = int(self._joint.bodyid[0])
        self._parent = int(model.body_parentid[self._body])

    def get_state(self):
        """Nothing: the time is in the data."""

    def set_state(self, state):
        """Nothing."""

    def _force(self, time_s):
        c = self._config
        return c.slope * time_s + c.amplitude * math.sin(c.rate_rad_s * time_s)

    def wrenches(self, data):
        along = self._force(data.time) * data.xaxis[self._joint.id]
        point, zero = data.xanchor[self._joint.id].copy(), np.zeros(3)
        force, torque = (along, zero) if self._joint.type[0] == 2 else (zero, along)
        return Wrench(self._parent, point, -force, -torque), Wrench(self._body, point, force, torque)
