"""Outside and internal forces that are polynomials of time: loads that vary inside control ticks."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from ffsm_mj.config import StrictModel
from ffsm_mj.contact_models.interface import ContactModel, ForceSource
from ffsm_mj.records.contact_forces import Wrench

Vector = tuple[float, float, float]
Powers = Annotated[tuple[Vector, ...], Field(max_length=4)]


class LoadConfig(StrictModel):
    """A force and a torque on a body, and their reaction on another."""

    on: str
    """Geom or body on whose body the load acts."""
    reaction: str
    """Geom or body whose body takes the reaction; a fixed one makes it an outside load."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Where the force acts, in the frame of the body."""
    force_N: Powers = ()
    """Coefficients of 1, t, t^2, ... in N, N/s, ..."""
    torque_N_m: Powers = ()
    """The same of the torque."""
    axes: str | None = None
    """Body in whose axes the coefficients are; left out: world axes."""


class LoadsConfig(StrictModel):
    """Loads of a scene."""

    kind: Literal["loads"]
    loads: tuple[LoadConfig, ...]


class Loads(ContactModel, ForceSource):
    """Forces and torques that depend on time alone."""

    kind = "loads"
    Config = LoadsConfig
    active = True

    def __init__(self, config: LoadsConfig, scene: Any) -> None:
        super().__init__(config, scene)
        model = scene.system.mj
        self._loads = [
            (
                _body(model, load.on),
                _body(model, load.reaction),
                np.array(load.at_m),
                _powers(load.force_N),
                _powers(load.torque_N_m),
                None if load.axes is None else _body(model, load.axes),
            )
            for load in config.loads
        ]

    def wrenches(self, data):
        found = []
        for body, reaction, at, forces, torques, axes in self._loads:
            turn = np.eye(3) if axes is None else data.xmat[axes].reshape(3, 3)
            powers = data.time ** np.arange(4)
            force, torque = turn @ (powers @ forces), turn @ (powers @ torques)
            point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ at
            found += [Wrench(body, point, force, torque), Wrench(reaction, point, -force, -torque)]
        return found


def _powers(coefficients):
    """Coefficients of the powers 0 to 3, (4, 3)."""
    full = np.zeros((4, 3))
    full[: len(coefficients)] = np.array(coefficients).reshape(-1, 3)
    return full


def _body(model: Any, name: str) -> int:
    for geom in range(model.ngeom):
        if model.geom(geom).name == name:
            return int(model.geom_bodyid[geom])
    return int(model.body(name).id)
