from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray, IntArray

class OnSample:
    def __call__(self, time_s: float) -> None: ...

class Clock(OnSample):
    def __init__(self, time: FloatArray) -> None: ...

class Maxima(OnSample):
    def __init__(self, since: FloatArray, logged: FloatArray) -> None: ...

class ServoSample(OnSample):
    def __init__(
        self,
        model: Any,
        unlimited: Any,
        data: Any,
        servos: IntArray,
        gear: FloatArray,
        ranges: FloatArray,
        forces: FloatArray,
    ) -> None: ...

class Periodically(OnSample):
    last_s: float
    is_resumed: bool
    def __init__(self, period_s: float, function: Callable[[], object]) -> None: ...
    def resume(self, with_values: bool) -> None: ...

class Sampler:
    jacp: FloatArray
    jacr: FloatArray
    twist: FloatArray
    def __init__(self, model: Any, data: Any, *, base: int = -1, tip: int = -1) -> None: ...
    def copy(self, copies: Sequence[tuple[FloatArray, FloatArray]]) -> None: ...
    def take(self, line: int) -> int: ...

class Collect(OnSample):
    def __init__(self, sampler: Sampler) -> None: ...

class RowFiller:
    def __init__(self, sampler: Sampler, on_sample: Iterable[Callable[[float], None]]) -> None: ...
    def fill(self, line: int, time_s: float) -> int: ...

class StageWork:
    def __init__(self, done: FloatArray, account: FloatArray) -> None: ...
    def open(self) -> None: ...
    def close(self, duration_s: float, /) -> int: ...

class StepWork:
    def __init__(
        self,
        data: Any,
        on_joint: FloatArray,
        external: FloatArray,
        account: FloatArray,
        gained: FloatArray,
        contact: FloatArray,
        fixed: FloatArray,
        always: Iterable[Any] = (),
        outside: Iterable[Any] = (),
    ) -> None: ...
    def enter(self, energy: FloatArray, contact: FloatArray, fixed: FloatArray) -> None: ...
    def open(self) -> int: ...
    def close(self, duration_s: float) -> int: ...

class Bounds(Protocol):
    @property
    def low(self) -> FloatArray: ...
    @property
    def high(self) -> FloatArray: ...
    @property
    def stall(self) -> FloatArray: ...
    @property
    def slope(self) -> FloatArray: ...
    @property
    def saturation(self) -> FloatArray: ...
    @property
    def gear(self) -> FloatArray: ...
    @property
    def keeps(self) -> npt.NDArray[np.bool_]: ...

class Limits:
    def __init__(
        self,
        bounds: Bounds,
        effort: FloatArray,
        powered: npt.NDArray[np.bool_],
        velocity: FloatArray,
        table: FloatArray,
        ctrl: FloatArray,
    ) -> None: ...
    def apply(self) -> bool: ...

class SteadyForces:
    def goes_on(self, left_s: float = ...) -> bool: ...

class TickLaw: ...
