from collections.abc import Callable, Sequence
from typing import Any

from ffsm_mj._core.fields import FieldForces
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.dynamics.actuators import Activations, DeadBands, ExternalServos, ForceLimits
from ffsm_mj.dynamics.implicit_stages import ImplicitStep
from ffsm_mj.dynamics.stiff_actuators import StiffActuators

WHOLE_STATE: int
BOUND_MARGIN: float
WEIGHTS: FloatArray

class FreeStepper:
    energy: float
    motion_bound: float
    last_increment: float
    event_bound: float
    kinked: bool
    bands: DeadBands | None
    def __init__(self, model: Any, data: Any, state: FloatArray, momentum: FloatArray) -> None: ...
    def clear(self, event_bound: float) -> None: ...
    def step(self, duration_s: float) -> bool: ...
    def account(self, duration_s: float) -> bool: ...

class ActuatorPower:
    work: FloatArray
    outside: ExternalServos | None
    kinked: bool
    def __init__(
        self,
        data: Any,
        trees: IntArray,
        apart: IntArray,
        work: FloatArray,
        limits: ForceLimits,
        outside: ExternalServos | None = None,
    ) -> None: ...
    def add(self, weight: float) -> None: ...
    def end(self, duration_s: float) -> None: ...

class ForcedStepper(FreeStepper):
    implicit: bool
    inside: bool
    solved: bool
    repeats: int
    stage: ImplicitStep | None
    start_rates: FloatArray
    rotations: Sequence[slice]
    power: ActuatorPower | None
    field: FieldForces | None
    stiff: StiffActuators | None
    activations: Activations | None
    def __init__(
        self,
        model: Any,
        data: Any,
        state: FloatArray,
        momentum: FloatArray,
        pushes: Sequence[Callable[[Any], object]],
        follow: Callable[[], None] | None,
        power: ActuatorPower | None = None,
    ) -> None: ...
    @property
    def weights(self) -> FloatArray: ...
    def refresh(self) -> None: ...
    def integrate(self, duration_s: float) -> None: ...
