"""What the law ``detumble`` has come to: momenta, saturation, load of the grasp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ffsm_controllers.detumble.config import DetumbleConfig
from ffsm_controllers.detumble.latch import GraspLoad
from ffsm_controllers.detumble.wheels import WheelShare
from ffsm_mj.controller_protocol import ControllerReport, FloatArray, Stateful


class DetumbleOutcome(Stateful):
    """Accumulates what the law reports.

    Attributes:
        values: Momentum without the wheels, momentum of the wheels, share of the demand, at the last tick.
        is_below: Whether the first of them is below its tolerance.
    """

    @dataclass
    class State:
        """Values of the last tick, momentum at the first one, saturation, load and shares so far."""

        values: tuple[float, ...]
        is_below: bool
        first: float | None
        saturated_s: float | None
        full: tuple[str, ...]
        left: float
        fired: bool
        alone: float
        least_share: float

    def __init__(self, config: DetumbleConfig, wheels: Sequence[str]) -> None:
        """Know the tolerance, and the names of the wheels."""
        self._config, self._wheels = config, tuple(wheels)
        self.values: tuple[float, ...] = (math.nan, math.nan, math.nan)
        self.is_below = False
        self._first: float | None = None
        self._saturated_s: float | None = None
        self._full: tuple[str, ...] = ()
        self._left = 0.0
        self._fired, self._alone, self._least_share = False, 0.0, 1.0

    def start(self) -> None:
        """The phase begins here."""
        self.is_below = False

    def look(
        self, time_s: float, rest: FloatArray, h: FloatArray, s: float, share: WheelShare, thrust: FloatArray | None
    ) -> None:
        """Take note of a tick."""
        left = math.hypot(*rest.tolist())
        self.values = left, math.hypot(*h.sum(axis=0).tolist()), s
        self.is_below = left < self._config.tolerance_N_m_s
        if self._first is None:
            self._first = left
        self._left = math.hypot(*share.left.tolist()) / self._config.rate_1_s
        full = tuple(name for name, is_full in zip(self._wheels, share.full.tolist(), strict=True) if is_full)
        if full and self._left > self._config.tolerance_N_m_s:
            self._full = full
            self._saturated_s = time_s if self._saturated_s is None else self._saturated_s
        self._fired |= thrust is not None and bool(thrust.any())
        self._least_share = min(self._least_share, s)

    def load(self, ratio: float) -> None:
        """Take note of the ratio of load to bound without any effort of wheels and thrusters."""
        self._alone = max(self._alone, ratio)

    def report(self, latch: GraspLoad) -> ControllerReport:
        """Numbers, and a note on what could not be done."""
        if self._first is None:
            return {}
        values: dict[str, float | str] = {
            "initial_stack_momentum_N_m_s": self._first,
            "stack_momentum_N_m_s": self.values[0],
            "wheel_momentum_N_m_s": self.values[1],
            "least_share": self._least_share,
        }
        if self._saturated_s is not None:
            values["saturated_s"] = self._saturated_s
        if latch.is_bounded:
            values["largest_load_ratio"] = self._alone
        notes = self._notes()
        return {**values, "note": "; ".join(notes)} if notes else values

    def _notes(self) -> list[str]:
        left, config = self.values[0], self._config
        notes = []
        if self._alone > 1.0:
            notes.append(f"the rotation alone loads the grasp {self._alone:.3g} times as much as allowed")
        if not config.wheels and not config.thrusters:
            notes.append(
                f"no wheels and no thrusters: {left:.4g} N m s stays in the stack, joints only pass it from body to body"
            )
        elif self._saturated_s is not None and not config.thrusters:
            notes.append(
                f"{', '.join(self._full)} saturated at {self._saturated_s:.3f} s, there are no thrusters: {left:.4g} N m s "
                "is left in the stack without its wheels"
            )
        elif self._saturated_s is None and self._left > config.tolerance_N_m_s and not config.thrusters:
            notes.append(f"no wheel has an axis along {self._left:.4g} N m s of the momentum, there are no thrusters")
        elif self._saturated_s is not None:
            after = "thrusters unload them" if self._fired else "thrusters did not fire"
            notes.append(f"{', '.join(self._full)} saturated at {self._saturated_s:.3f} s, {after}")
        return notes
