from collections.abc import Sequence
from typing import Protocol

from ffsm_mj._core.fields import CompiledField, FieldForces
from ffsm_mj._core.orbit import Reference
from ffsm_mj._core.tick import OnSample
from ffsm_mj.arrays import FloatArray

class _Fields(Protocol):
    @property
    def forces(self) -> FieldForces: ...

def earth_rotation_angle(days: float) -> float: ...

class MagneticField:
    def at(self, time_s: float, position_m: FloatArray) -> FloatArray: ...

class UniformMagneticField(MagneticField):
    def __init__(self, field_T: Sequence[float]) -> None: ...

class Dipole(MagneticField):
    def __init__(self, reference: Reference, axes: FloatArray, moment_T: Sequence[float], days: float) -> None: ...

class Magnetorquers(CompiledField):
    def __init__(
        self, actuators: Sequence[int], bodies: Sequence[int], axes: Sequence[FloatArray], magnetic: MagneticField
    ) -> None: ...

class TorqueSample(OnSample):
    row: FloatArray
    def __init__(self, torquers: Magnetorquers, fields: _Fields, controls: FloatArray) -> None: ...
