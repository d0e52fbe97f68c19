"""Random numbers of sensors: a function of (seed, name, sample), so that no other sensor and no restart changes them."""

from __future__ import annotations

from zlib import crc32

import numpy as np

from ffsm_mj.arrays import FloatArray

BLOCK = 256
"""Samples that are drawn at once."""


class NoiseStream:
    """Random numbers of one purpose of one sensor.

    Numbers of a block come from a Philox generator whose key is (seed, CRC-32 of the name) and whose counter begins at the
    block, so that any sample can be drawn without those before it.
    """

    def __init__(self, seed: int, name: str, size: int) -> None:
        """Draw nothing yet.

        Args:
            seed: Seed of the run.
            name: Name of the sensor and of the purpose.
            size: Numbers per sample.
        """
        self._key = np.array((seed, crc32(name.encode())), dtype=np.uint64)
        self._size = size
        self._normal: tuple[int, FloatArray] = -1, np.empty((0, size))
        self._uniform: tuple[int, FloatArray] = -1, np.empty((0, size))

    def _generator(self, block: int) -> np.random.Generator:
        counter = np.array((0, 0, block, 0), dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=self._key, counter=counter))

    def block(self, block: int) -> FloatArray:
        """Standard normal numbers of a block of samples, (BLOCK, size)."""
        if self._normal[0] != block:
            self._normal = block, self._generator(block).standard_normal((BLOCK, self._size))
        return self._normal[1]

    def normal(self, sample: int) -> FloatArray:
        """Standard normal numbers of a sample, (size,)."""
        block, line = divmod(sample, BLOCK)
        numbers: FloatArray = self.block(block)[line]
        return numbers

    def uniform(self, sample: int) -> FloatArray:
        """Uniform numbers in [0, 1) of a sample, (size,)."""
        block, line = divmod(sample, BLOCK)
        if self._uniform[0] != block:
            self._uniform = block, self._generator(block).random((BLOCK, self._size))
        numbers: FloatArray = self._uniform[1][line]
        return numbers


class RandomWalk:
    """Random walk over the samples of a sensor: the sum of standard normal numbers up to a sample."""

    def __init__(self, stream: NoiseStream, size: int) -> None:
        """At zero before the first sample."""
        self._stream, self._size = stream, size
        self._sample, self._sum = -1, np.zeros(size)

    def at(self, sample: int) -> FloatArray:
        """Sum of the numbers of samples 1 to ``sample``, (size,): zero at sample 0."""
        if sample < self._sample:
            self._sample, self._sum = -1, np.zeros(self._size)
        while self._sample < sample:
            self._sample += 1
            if self._sample > 0:
                self._sum = self._sum + self._stream.normal(self._sample)
        return self._sum
