"""Random numbers of one topic of a scene: each topic has a stream of its own, so that a new feature changes no other one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeVar
from zlib import crc32

import numpy as np

T = TypeVar("T")


class Dice:
    """Draws of one topic of one seed."""

    def __init__(self, seed: int, topic: str) -> None:
        self.rng = np.random.default_rng([seed, crc32(topic.encode())])

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def log_between(self, low: float, high: float) -> float:
        return math.exp(self.between(math.log(low), math.log(high)))

    def integer(self, low: int, high: int) -> int:
        """A whole number from ``low`` to ``high``, both included."""
        return int(self.rng.integers(low, high + 1))

    def pick(self, options: Sequence[T]) -> T:
        return options[int(self.rng.integers(len(options)))]

    def some(self, options: Sequence[T], most: int) -> list[T]:
        """Up to ``most`` different ones, in their order."""
        count = min(len(options), self.integer(0, most))
        return [options[i] for i in sorted(self.rng.choice(len(options), count, replace=False))]

    def vector(self, size: float) -> list[float]:
        """Three numbers of a normal distribution."""
        return (size * self.rng.normal(size=3)).tolist()

    def direction(self) -> list[float]:
        v = self.rng.normal(size=3)
        return (v / np.linalg.norm(v)).tolist()

    def turn(self, share: float = 1.0) -> list[float]:
        """A uniform quaternion (w, x, y, z) in a share of the cases, else that of no turn."""
        if not self.chance(share):
            return [1.0, 0.0, 0.0, 0.0]
        q = self.rng.normal(size=4)
        return (q / np.linalg.norm(q)).tolist()


def numbers(values: Any) -> str:
    """Numbers as an attribute of MJCF, to the last bit."""
    return " ".join(repr(float(value)) for value in np.atleast_1d(values))
