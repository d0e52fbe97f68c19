from collections.abc import Sequence
from typing import Any, Protocol

from ffsm_mj._core.fields import Bodies, CompiledField, FieldForces
from ffsm_mj._core.tick import OnSample
from ffsm_mj.arrays import FloatArray

class _Fields(Protocol):
    @property
    def forces(self) -> FieldForces: ...

class Reference:
    def state(self, time_s: float) -> tuple[FloatArray, FloatArray]: ...
    def states(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]: ...

class PiecewiseOrbit(Reference):
    def __init__(self, piece_s: float) -> None: ...
    def next_piece(self) -> FloatArray: ...

class KeplerOrbit(Reference):
    mu: float
    semi_major_axis_m: float
    rate_rad_s: float
    def __init__(
        self, mu: float, position_m: Sequence[float] | FloatArray, velocity_m_s: Sequence[float] | FloatArray
    ) -> None: ...

class OrbitalField(CompiledField):
    reference: Reference
    def __init__(
        self, reference: Reference, mu: float, oblateness: float = 0.0, pole: Sequence[float] | FloatArray = (0.0, 0.0, 1.0)
    ) -> None: ...
    def acceleration(self, time_s: float, position: FloatArray) -> FloatArray: ...
    def potential(self, time_s: float, bodies: Bodies, /) -> float: ...

class OrbitSample(OnSample):
    row: FloatArray
    def __init__(self, field: OrbitalField, fields: _Fields, model: Any, data: Any, bodies: Sequence[int]) -> None: ...

def lvlh_axes(
    positions: FloatArray, velocities: FloatArray, oblateness: float, pole: Sequence[float] | FloatArray
) -> tuple[FloatArray, FloatArray]: ...
