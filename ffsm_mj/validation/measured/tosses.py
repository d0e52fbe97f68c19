"""Tosses of a cube: their files, which are legacy pickles of PyTorch, read without PyTorch; and their free flight."""

from __future__ import annotations

import io
import pickle
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError

RATE_HZ = 148.0
HALF_WIDTH_M = 0.0524
"""Half width of the cube, in which the positions of the files are."""
SCALE = 0.98
"""True metre over the metre of the files: free fall and the height at rest are both 2 % short of the cube's and of g."""
CLEAR_M = 0.008
"""Height of the lowest corner above which a frame is free flight: a frame of the fastest fall, and the tag's offset."""
LEAST_FREE_FRAMES = 5
"""Frames of free flight from which a state is fitted; parabolas of fewer follow their noise."""
_COLUMNS = 19
_STATE = 13
_LARGEST = 1 << 24
"""Bytes of a file at most: the longest toss takes 70 kB."""
_HEIGHTS = (0.5, 50.0)
"""Heights of the centre that a toss can have: a cube on the floor is at 1; tosses in m or mm are outside."""
_MAGIC = 0x1950A86A20F9469CFC6C
_CORNERS = np.array([*product((-1.0, 1.0), repeat=3)])


class _Unpickler(pickle.Unpickler):
    """Reads what a tensor of doubles is pickled as, and nothing else: no other name is looked up, nothing is executed."""

    def find_class(self, module: str, name: str) -> Any:
        """The three names of such a file."""
        match module, name:
            case "torch._utils", "_rebuild_tensor_v2":
                return lambda _storage, offset, size, stride, *_: (offset, size, stride)
            case "torch", "DoubleStorage":
                return "DoubleStorage"
            case "collections", "OrderedDict":
                return OrderedDict
        raise pickle.UnpicklingError(f"it names {module}.{name}, which no tensor of doubles does")

    def persistent_load(self, pid: Any) -> Any:
        """The storage of a tensor: its kind, key, device and number of elements."""
        return pid


@dataclass(frozen=True)
class Toss:
    """A toss as recorded, in the metre of the files.

    Attributes:
        positions: Of the cube's centre, m, (n, 3).
        quaternions: Its orientation, w x y z, (n, 4).
        velocities: Of the centre, m/s, (n, 3), as tabulated.
        rates: Angular velocity in the axes of the cube, rad/s, (n, 3), as tabulated.
    """

    positions: FloatArray
    quaternions: FloatArray
    velocities: FloatArray
    rates: FloatArray

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def rotations(self) -> Rotation:
        """The orientations."""
        return Rotation.from_quat(self.quaternions, scalar_first=True)

    @cached_property
    def lowest(self) -> FloatArray:
        """Heights of the lowest corner, m, (n,)."""
        corners = np.einsum("nij,cj->nci", self.rotations.as_matrix(), SCALE * HALF_WIDTH_M * _CORNERS)
        return np.asarray(self.positions[:, 2] + corners[:, :, 2].min(axis=1))

    @cached_property
    def free_frames(self) -> int:
        """Number of frames of free flight at the beginning."""
        low = np.flatnonzero(self.lowest <= CLEAR_M)
        return int(low[0]) if len(low) else len(self)

    @property
    def first_state(self) -> FloatArray:
        """State of the first frame as tabulated: position, quaternion, velocity, rates, (13,)."""
        return np.concatenate([self.positions[0], self.quaternions[0], self.velocities[0], self.rates[0]])

    def gravity(self) -> float:
        """Downward acceleration in the flight, m/s^2, in the metre of the files."""
        times = np.arange(self.free_frames) / RATE_HZ
        return -2.0 * float(np.polyfit(times, self.positions[: self.free_frames, 2], 2)[0])

    def free_flight_state(self, gravity: float) -> FloatArray:
        """State at the last frame of free flight, of the parabola and the steady rotation nearest to the flight, (13,).

        A cube's moments of inertia are equal, so that its angular velocity is constant in the world.
        """
        n = self.free_frames
        times = (np.arange(n) - (n - 1)) / RATE_HZ
        design = np.stack([np.ones(n), times], axis=1)
        fall = 0.5 * gravity * np.outer(times**2, (0.0, 0.0, 1.0))
        position, velocity = np.linalg.lstsq(design, self.positions[:n] + fall)[0]
        rotations = self.rotations[:n]
        last = rotations[-1]
        rate = np.mean((rotations[1:] * rotations[:-1].inv()).as_rotvec(), axis=0) * RATE_HZ
        for _ in range(4):  # Gauss-Newton: the residuals are 1e-3 rad, and each step squares what is left
            steady = Rotation.from_rotvec(np.outer(times, rate)) * last
            turn, change = np.linalg.lstsq(design, (rotations * steady.inv()).as_rotvec())[0]
            last, rate = Rotation.from_rotvec(turn) * last, rate + change
        return np.concatenate([position, last.as_quat(scalar_first=True), velocity, last.inv().apply(rate)])


def read_toss(data: bytes, name: str) -> Toss:
    """A toss from the contents of its file.

    Args:
        data: The contents.
        name: Path of the file, for messages.

    Raises:
        InputError: It is no legacy file of PyTorch with one tensor of doubles, (1, n, 19), or names anything else.
    """
    try:
        table = _tensor(data)
    except Exception as error:  # noqa: BLE001 (a foreign pickle fails in any way)
        raise InputError(f"{name}: not a tensor of doubles of a toss ({error})") from None
    if len(table) < 3 or not np.isfinite(table).all():
        raise InputError(f"{name}: {len(table)} frames; at least 3 of finite numbers are allowed")
    norms = np.linalg.norm(table[:, 3:7], axis=1)
    if np.abs(norms - 1.0).max() > 1e-3:
        raise InputError(f"{name}: columns 4 to 7 are no unit quaternions (norm {norms[np.argmax(np.abs(norms - 1))]:.4g})")
    low, high = table[:, 2].min(), table[:, 2].max()
    if low < _HEIGHTS[0] or high > _HEIGHTS[1]:
        raise InputError(
            f"{name}: column 3, the height in half widths of the cube, is {low:.4g} to {high:.4g};"
            f" {_HEIGHTS[0]:g} to {_HEIGHTS[1]:g} is allowed"
        )
    return Toss(HALF_WIDTH_M * table[:, :3], table[:, 3:7], HALF_WIDTH_M * table[:, 7:10], table[:, 10:_STATE])


def _tensor(data: bytes) -> FloatArray:
    """The tensor of a file, (n, 19).

    Raises:
        ValueError: It is another one.
    """
    if len(data) > _LARGEST:
        raise ValueError(f"{len(data)} bytes; at most {_LARGEST} are allowed")
    file = io.BytesIO(data)
    magic, _, _ = (_Unpickler(file).load() for _ in range(3))  # magic number, protocol, sizes of types
    if magic != _MAGIC:
        raise ValueError("it does not begin as a file of PyTorch before 1.6")
    offset, size, stride = _Unpickler(file).load()
    _Unpickler(file).load()  # the keys of its storages: one
    (count,) = np.frombuffer(file.read(8), dtype="<i8").tolist()
    storage = np.frombuffer(file.read(), dtype="<f8")
    if len(size) != 3 or (size[0], size[2]) != (1, _COLUMNS):
        raise ValueError(f"a tensor of shape {tuple(size)}; (1, n, {_COLUMNS}) is allowed")
    n = size[1]
    if tuple(stride[1:]) != (_COLUMNS, 1) or offset != 0 or not len(storage) == count == n * _COLUMNS:
        raise ValueError(f"{len(storage)} numbers for {n} frames of {_COLUMNS}")
    return storage.reshape(n, _COLUMNS).astype(np.float64)
