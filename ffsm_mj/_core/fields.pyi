from collections.abc import Sequence
from typing import Any, Protocol

from ffsm_mj.arrays import FloatArray

class _Field(Protocol):
    def add_wrenches(self, time_s: float, bodies: Bodies, /) -> object: ...

class Bodies:
    names: tuple[str, ...]
    mass_kg: FloatArray
    inertia_kg_m2: FloatArray
    position_m: FloatArray
    axes: FloatArray
    velocity_m_s: FloatArray
    angular_velocity_rad_s: FloatArray
    force_N: FloatArray
    torque_N_m: FloatArray
    def __init__(self, names: Sequence[str], masses: FloatArray, inertias: FloatArray) -> None: ...

class CompiledField:
    def add_wrenches(self, time_s: float, bodies: Bodies) -> None: ...

class UniformField(CompiledField):
    def __init__(self, acceleration_m_s2: Sequence[float]) -> None: ...

class FieldForces:
    bodies: Bodies
    done: FloatArray
    def __init__(
        self,
        model: Any,
        data: Any,
        ids: Sequence[int],
        trees: Sequence[int],
        bodies: Bodies,
        fields: Sequence[_Field],
        done: FloatArray,
    ) -> None: ...
    def push(self, data: Any) -> None: ...
    def add_to(self, data: Any, applied: FloatArray) -> None: ...
    def evaluate_now(self) -> None: ...
    def begin(self) -> int: ...
    def add(self, weight: float, /) -> int: ...
    def end(self, duration_s: float, /) -> int: ...
