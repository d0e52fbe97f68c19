"""Pickles of what a simulation remembers, with references to objects that a simulation of the same scenario has too."""

from __future__ import annotations

import io
import pickle
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from ffsm_mj.simulation.array_blocks import ArrayBlocks


class StatePickler(pickle.Pickler):
    """Pickles contents: objects of the walk by number, arrays that are views of their memory as views."""

    def __init__(self, file: io.BytesIO, numbers: Mapping[int, int], blocks: ArrayBlocks) -> None:
        """Start.

        Args:
            file: Where to write.
            numbers: Numbers of objects by ``id``.
            blocks: Memory that these objects own.
        """
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._numbers, self._blocks = numbers, blocks

    def persistent_id(self, obj: Any) -> int | None:
        """Number of an object of the walk."""
        return self._numbers.get(id(obj))

    def reducer_override(self, obj: Any) -> Any:
        """Views as views, since copies would not follow what they show; read-only mappings; functions of LAPACK by name."""
        if isinstance(obj, np.ndarray):
            return self._blocks.reduced(obj) if obj.base is not None else NotImplemented
        if isinstance(obj, MappingProxyType):
            return _read_only, (dict(obj),)
        if isinstance(obj, memoryview):
            return memoryview, (np.asarray(obj),)
        if type(obj).__name__ == "fortran":
            return _lapack, (obj.__name__.removeprefix("function "),)
        return NotImplemented


class StateUnpickler(pickle.Unpickler):
    """Reads them back; objects of the walk are those given."""

    def __init__(self, file: io.BytesIO, objects: list[Any]) -> None:
        """Start at the beginning of a file."""
        super().__init__(file)
        self._objects = objects

    def persistent_load(self, number: int) -> Any:
        """Object of the walk."""
        return self._objects[number]


def _read_only(mapping: dict[Any, Any]) -> Mapping[Any, Any]:
    return MappingProxyType(mapping)


def _lapack(name: str) -> Any:
    from scipy.linalg import lapack  # a third of a second to import

    return getattr(lapack, name)
