from ffsm_mj.arrays import FloatArray

class Travel:
    travelled: FloatArray
    last: FloatArray
    length: float
    is_within: bool
    def __init__(self, rates: FloatArray) -> None: ...
    def begin(self, weights: FloatArray, reach: float) -> None: ...
    def add(self, duration_s: float) -> bool: ...
