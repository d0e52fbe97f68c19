"""Columns of the state: time, coordinates, rates, and the tip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj._core.tick import Clock, Sampler
from ffsm_mj.dynamics.target_motion import TargetMotion
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import Signal, coordinate_names, rate_names, unit_of


class StateSignals:
    """The state in ``data`` as columns.

    Attributes:
        sampler: Updates the tip velocity at each sample, and copies live arrays.
        columns: Columns of the state.
    """

    def __init__(
        self, system: System, data: Any, tip_site: int | None, axes: Sequence[int] = (), target: TargetMotion | None = None
    ) -> None:
        """Bind to a system.

        Args:
            system: The logged system.
            data: Its data, derived quantities current at each sample.
            tip_site: Site of the task; None if there is no task.
            axes: Its world axes.
            target: How its target moves; None: it does not.
        """
        time = np.zeros(1)
        self.sampler = Sampler(system.mj, data, tip=-1 if tip_site is None else tip_site)
        self.columns: tuple[Columns, ...] = (
            Columns((Signal("state", "time_s", "s", "simulation time"),), live=time, on_sample=Clock(time)),
            Columns(_coordinates(system), live=data.qpos),
            Columns(_rates(system), live=data.qvel),
        )
        if tip_site is not None:
            self.columns += (
                Columns(_tip("tip_{}_m", "m", "position of the tip"), live=data.site_xpos[tip_site]),
                Columns(_tip("tip_v{}_m_s", "m/s", "velocity of the tip"), live=self.sampler.twist[3:]),
            )

        self._data, self._axes, self._target, self._place = data, list(axes), target, np.zeros(3)
        if target is not None:
            meaning = "target of the tip, zero along axes that are not regulated"
            signals = _tip("target_{}_m", "m", meaning)
            self.columns += (Columns(signals, live=self._place, on_sample=self._follow),)

    def _follow(self, time_s: float) -> None:
        assert self._target is not None
        self._target.update(time_s, self._data)
        self._place[self._axes] = self._target.position_m


def _coordinates(system: System) -> tuple[Signal, ...]:
    return tuple(
        Signal("state", f"q_{name}", unit_of(name), f"coordinate of {joint.kind} joint {joint.name}", f"joint {joint.name}")
        for joint in sorted(system.joints.values(), key=lambda joint: joint.qpos.start)
        for name in coordinate_names(joint)
    )


def _rates(system: System) -> tuple[Signal, ...]:
    signals = []
    for joint in sorted(system.joints.values(), key=lambda joint: joint.qpos.start):
        frame = ", linear part in world axes, angular part in body axes" if joint.kind == "free" else ""
        meaning = f"rate of {joint.kind} joint {joint.name}{frame}"
        signals += [
            Signal("state", f"v_{name}", unit_of(name), meaning, f"joint {joint.name}") for name in rate_names(joint)
        ]
    return tuple(signals)


def _tip(name: str, unit: str, meaning: str) -> tuple[Signal, ...]:
    return tuple(Signal("state", name.format(axis), unit, meaning) for axis in "xyz")
