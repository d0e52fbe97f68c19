from collections.abc import Sequence
from typing import Any, Protocol

from ffsm_mj.arrays import FloatArray

class _Field(Protocol):
    def add_wrenches(self, time_s: float, bodies: Bodies, /) -> object: ...

class _Reference(Protocol):
    def state(self, time_s: float, /) -> tuple[FloatArray, FloatArray]: ...

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
    def add_wrenches(self, time_s: float, bodies: Bodies, /) -> int: ...

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
    def push(self, data: Any, /) -> int: ...
    def add_to(self, data: Any, applied: FloatArray) -> None: ...
    def evaluate_now(self) -> None: ...
    def begin(self) -> int: ...
    def add(self, weight: float, /) -> int: ...
    def end(self, duration_s: float, /) -> int: ...

class KeplerOrbit:
    mu: float
    semi_major_axis_m: float
    rate_rad_s: float
    def __init__(
        self, mu: float, position_m: Sequence[float] | FloatArray, velocity_m_s: Sequence[float] | FloatArray
    ) -> None: ...
    def state(self, time_s: float, /) -> tuple[FloatArray, FloatArray]: ...
    def states(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]: ...

class OrbitalField(CompiledField):
    reference: _Reference
    def __init__(
        self, reference: _Reference, mu: float, oblateness: float = 0.0, pole: Sequence[float] | FloatArray = (0.0, 0.0, 1.0)
    ) -> None: ...
    def acceleration(self, time_s: float, position: FloatArray) -> FloatArray: ...
    def potential(self, time_s: float, bodies: Bodies) -> float: ...
