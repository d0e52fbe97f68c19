"""What an estimator sees and what it writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from ffsm_mj.records.signals import Signal
from ffsm_mj.sensing.measurement import Measurement


class Estimator(Protocol):
    """Estimates the state from measurements; control laws see a state of which they need not know that it is one.

    A class with a ``Config`` is built as ``cls(config, context)``, as a control law is; the instance carries its state. It
    has the pair ``get_state()`` and ``set_state(state)``, as a control law that remembers: an estimator is restored by
    ``start`` with the estimate of that time, and then ``set_state``.
    """

    @property
    def telemetry_signals(self) -> tuple[Signal, ...]:
        """What it reports of every call; a plain attribute of the class will do."""

    def start(self, data: Any) -> None:
        """Begin: ``data`` holds the initial state of the scenario, which is known."""

    def update(self, time_s: float, measured: Mapping[str, Measurement], events: Sequence[Any], data: Any) -> None:
        """Write the estimate at a time into ``data.qpos`` and ``data.qvel``, which hold that of the last call.

        Args:
            time_s: Time, s; ``data.time`` has that of the last call.
            measured: Newest sample of each sensor that has arrived, by full name.
            events: What the robot is told of events since the last call: their class, time and pair.
            data: MuJoCo data of the model that control laws use, with the efforts held until now in ``ctrl``.
        """

    def telemetry(self) -> Sequence[float]:
        """Values of ``telemetry_signals`` after the last call."""
