from collections.abc import Sequence
from typing import Any, NamedTuple

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.dynamics.motion import Motion

class Slide(NamedTuple):
    heat: FloatArray
    speeds: FloatArray

class Smooth:
    motion: Motion
    def __init__(self, motion: Motion, seen: Any) -> None: ...
    def kinematics(self) -> object: ...
    def load(self, pushes: FloatArray) -> object: ...
    def state(self, pushes: FloatArray) -> tuple[object, object]: ...
    def force(self, pushes: FloatArray) -> FloatArray: ...

def dip(stages: list[Stage], stick_mu: FloatArray) -> float: ...

class StageSums:
    work: FloatArray
    total: float
    impulses: FloatArray
    sizes: list[float]
    def __init__(self, stages: Sequence[Stage], parts: FloatArray) -> None: ...
    def exchange(self, from_robot: FloatArray, outside: FloatArray, robot: slice) -> Exchange: ...
