"""Pickles of what a simulation remembers, with references to objects that a simulation of the same scenario has too."""

from __future__ import annotations

import inspect
import io
import pickle
from collections.abc import Mapping, Sequence
from importlib import import_module
from types import CellType, CodeType, FunctionType, MappingProxyType
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
        """How to pickle what pickle itself cannot, or would copy: views of memory, local functions, LAPACK's functions."""
        if isinstance(obj, np.ndarray):
            return self._blocks.reduced(obj) if obj.base is not None else NotImplemented
        if isinstance(obj, MappingProxyType):
            return _read_only, (dict(obj),)
        if isinstance(obj, memoryview):
            return memoryview, (np.asarray(obj),)
        if type(obj).__name__ == "fortran":
            return _lapack, (obj.__name__.removeprefix("function "),)
        if isinstance(obj, FunctionType) and "<locals>" in obj.__qualname__:
            return local_function, _place_of(obj)
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


def _place_of(function: FunctionType) -> tuple[Any, ...]:
    """Where the code of a local function stands, and what it has bound."""
    outer = function.__qualname__.partition(".<locals>")[0]
    path = _path_to(function.__code__, _code(function.__module__, outer))
    if path is None:
        raise pickle.PicklingError(f"{function.__module__}.{function.__qualname__} is not found in its module")
    cells = tuple(cell.cell_contents for cell in function.__closure__ or ())
    return function.__module__, outer, path, cells, function.__defaults__, function.__kwdefaults__


def local_function(
    module: str, outer: str, path: Sequence[int], cells: Sequence[Any], defaults: Any, keyword_defaults: Any
) -> FunctionType:
    """A function that was made within another one.

    Args:
        module: Module of both.
        outer: Name of the outer function in its module.
        path: Place of the code in the constants of the outer function, and of functions in between.
        cells: Values of the variables of outer functions that it uses.
        defaults: Defaults of its arguments.
        keyword_defaults: Defaults of its keyword arguments.
    """
    code = _code(module, outer)
    for place in path:
        code = code.co_consts[place]
    made = FunctionType(code, vars(import_module(module)), code.co_name, defaults, tuple(map(CellType, cells)))
    made.__kwdefaults__ = keyword_defaults
    made.__qualname__ = code.co_qualname
    return made


def _code(module: str, outer: str) -> CodeType:
    """Code of a function of a module."""
    found: Any = import_module(module)
    for name in outer.split("."):
        found = getattr(found, name)
    code: CodeType = inspect.unwrap(found).__code__
    return code


def _path_to(code: CodeType, outer: CodeType) -> tuple[int, ...] | None:
    for i, each in enumerate(outer.co_consts):
        if each is code:
            return (i,)
        if isinstance(each, CodeType) and (path := _path_to(code, each)) is not None:
            return (i, *path)
    return None


def _lapack(name: str) -> Any:
    from scipy.linalg import lapack  # a third of a second to import

    return getattr(lapack, name)
