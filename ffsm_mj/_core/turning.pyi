from ffsm_mj.arrays import FloatArray

def along(x: float, y: float) -> FloatArray: ...
def flat(corners: FloatArray, point: FloatArray, axes: FloatArray, at_end: float) -> FloatArray: ...
def turning(
    normal: FloatArray,
    axes: FloatArray,
    gap: float,
    *sides: tuple[FloatArray, FloatArray, FloatArray, FloatArray | None, float],
) -> FloatArray: ...
