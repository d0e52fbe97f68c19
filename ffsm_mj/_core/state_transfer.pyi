from typing import Any, Protocol

from ffsm_mj.arrays import FloatArray, IntArray

class BaseJoints(Protocol):
    base: tuple[FloatArray, FloatArray, FloatArray]
    free: bool
    reading: Any
    def pose(self, position: FloatArray, quaternion: FloatArray) -> None: ...
    def rates(self, twist: FloatArray) -> None: ...

class StateTransfer:
    def __init__(
        self,
        logged: tuple[Any, Any, FloatArray],
        moving: tuple[Any, Any, int],
        shared: tuple[tuple[IntArray, IntArray], tuple[IntArray, IntArray]],
        placing: BaseJoints,
    ) -> None: ...
    def state(self) -> None: ...
    def step(self) -> None: ...
