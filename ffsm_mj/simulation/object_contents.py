"""What an object of a simulation holds and remembers."""

from __future__ import annotations

import gc
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from enum import Enum
from functools import lru_cache, partial
from operator import attrgetter
from random import Random
from re import Pattern
from types import BuiltinFunctionType, FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any, TypeVar

import mujoco
import numpy as np

from ffsm_mj.config import StrictModel
from ffsm_mj.model.system import System
from ffsm_mj.simulation.mujoco_memory import DATA, MODEL

_GENERATORS = (Random, np.random.BitGenerator, np.random.RandomState)
CONSTANT = (
    tuple,
    frozenset,
    MappingProxyType,
    MethodType,
    BuiltinFunctionType,
    partial,
    StrictModel,
    System,
    np.random.Generator,
)
"""Types whose instances remember nothing themselves; what they hold may."""
_CONTAINERS = (list, dict, set, deque)
_KNOWN = (FunctionType, np.ndarray, mujoco.MjModel, mujoco.MjData)
_NUMBERS = (int, float, complex, np.generic, range, slice)
_UNCHANGING = (type, ModuleType, Enum, Pattern, np.dtype, np.ufunc, type(None), str, bytes, memoryview, *_NUMBERS)
_OF_FUNCTIONS = ("fortran", "pybind11")
"""Starts of the names of types of functions of LAPACK, and of what functions of MuJoCo hold."""
_CORE = "ffsm_mj._core"
_HEAP_TYPE = 1 << 9
"""Flag of types that a class statement makes."""
_Result = TypeVar("_Result")


class Changed(dict[str, Any]):
    """Some of the attributes of an object, which keeps the others."""


def _by_type(function: Callable[[Any], _Result]) -> Callable[[Any], _Result]:
    """Remember the results of a function of a type."""
    return lru_cache(maxsize=4096)(function)


def is_walked(found: Any) -> bool:
    """Whether an object has a number; others, as numbers and texts, are pickled where they are held."""
    return _is_walked(type(found))


@_by_type
def _is_walked(kind: Any) -> bool:
    if issubclass(kind, (type, ModuleType, Enum, BaseException)):
        return False
    if issubclass(kind, (*_CONTAINERS, *CONSTANT, *_GENERATORS, *_KNOWN)) or _is_of_core(kind):
        return True
    return _is_python(kind) and bool(kind.__dictoffset__ or _slots(kind))


def is_lost(found: Any) -> bool:
    """Whether an object without a number may change, so that one that cannot be exchanged must not hold it."""
    if isinstance(found, (*_UNCHANGING, BaseException)) or type(found).__name__.startswith(_OF_FUNCTIONS):
        return False
    return not is_walked(found)


def parts(found: Any) -> Iterable[Any]:
    """What an object holds, in an order that is the same in another process."""
    if _is_instance(type(found)) and sys.version_info < (3, 13):
        return _held(found)
    return (part for _, part in named_parts(found))


def _held(found: Any) -> list[Any]:
    """Values of the attributes of an instance, read without its ``__dict__``.

    Before Python 3.13, an instance whose ``__dict__`` has been read has slower attributes for the rest of its life: 5 us in
    a control tick of 28 us.
    """
    held = [each for each in gc.get_referents(found) if each is not type(found)]
    # One dictionary is the only attribute, or holds them all because something else has read it.
    if len(held) <= 1 + len(_slots(type(found))) and any(type(each) is dict for each in held):
        return list(_attributes(found).values())
    return held


def named_parts(found: Any) -> Iterator[tuple[str, Any]]:
    """What an object holds, with its place in it."""
    kind = type(found)
    if isinstance(found, System):
        yield ".mj", found.mj
        return
    if isinstance(found, (StrictModel, set, frozenset)) or _has_pair(kind):
        return  # a set holds numbers and names, in an order that is not the same in every process
    if isinstance(found, (*_CONTAINERS, FunctionType)) and kind.__dictoffset__:
        yield ".__dict__", vars(found)
    if isinstance(found, (dict, MappingProxyType)):
        yield from ((f"[{key!r}]", part) for key, part in found.items())
    elif isinstance(found, (list, tuple, deque)) or (isinstance(found, np.ndarray) and found.dtype == object):
        yield from ((f"[{i}]", part) for i, part in enumerate(found))
    elif isinstance(found, FunctionType):
        yield from ((f".{name}", part) for name, part in _bound(found).items())
        yield from ((".__defaults__", part) for part in (found.__defaults__, found.__kwdefaults__) if part)
    elif isinstance(found, (MethodType, BuiltinFunctionType)):
        yield ".__self__", found.__self__
    elif isinstance(found, partial):
        yield from ((f".{i}", part) for i, part in enumerate((found.func, *found.args, *found.keywords.values())))
    elif isinstance(found, np.random.Generator):
        yield ".bit_generator", found.bit_generator
    elif _is_instance(kind):
        yield from ((f".{name}", part) for name, part in _attributes(found).items())


def place_in(holder: Any, part: Any) -> str:
    """Place of a part in what holds it; empty if it is not held any more."""
    return next((place for place, each in named_parts(holder) if each is part), "")


def _bound(function: FunctionType) -> dict[str, Any]:
    """Variables of outer functions that a function uses, by name; not those without a value, and classes."""
    bound = {}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        with suppress(ValueError):
            bound[name] = cell.cell_contents
    return {name: value for name, value in bound.items() if not isinstance(value, (type, ModuleType))}


def content_of(found: Any) -> Any:
    """What an object remembers."""
    for kind, read, _ in _KINDS:
        if isinstance(found, kind):
            return read(found)
    if _is_of_core(type(found)):
        return _state_of_twin(found)
    return found.state() if _has_pair(type(found)) else _attributes(found)


def write(found: Any, content: Any) -> None:
    """Write into an object what it remembered."""
    for kind, _, write_kind in _KINDS:
        if isinstance(found, kind):
            write_kind(found, content)
            return
    if _is_of_core(type(found)):
        if content is not None:
            found.__setstate__(content)
    elif _has_pair(type(found)):
        found.restore(content)
    else:
        if not isinstance(content, Changed):
            for name in _attributes(found).keys() - content.keys():
                object.__delattr__(found, name)
        for name, value in content.items():
            object.__setattr__(found, name, value)


def _array(found: np.ndarray[Any, Any]) -> Any:
    return found.copy() if found.flags.writeable else None


def _write_array(found: np.ndarray[Any, Any], content: Any) -> None:
    if content is not None:
        found[...] = content


def _refill(container: Any, content: Any) -> None:
    container.clear()
    if isinstance(container, (list, deque)):
        container.extend(content)
    else:
        container.update(content)


def _bind(function: FunctionType, bound: dict[str, Any]) -> None:
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        if name in bound:
            cell.cell_contents = bound[name]


_KINDS: tuple[tuple[Any, Callable[[Any], Any], Callable[[Any, Any], Any]], ...] = (
    (mujoco.MjData, DATA.content, DATA.write),
    (mujoco.MjModel, MODEL.content, MODEL.write),
    (np.ndarray, _array, _write_array),
    (dict, dict, _refill),
    (_CONTAINERS, list, _refill),
    (FunctionType, _bound, _bind),
    (Random, Random.getstate, Random.setstate),
    (np.random.RandomState, np.random.RandomState.get_state, np.random.RandomState.set_state),
    (np.random.BitGenerator, attrgetter("state"), lambda found, content: setattr(found, "state", content)),
)
"""How contents are read and written, by kind; others have a pair of methods, or attributes."""


def _is_of_core(kind: type) -> bool:
    """Whether objects are compiled; those with a memory say so by ``__reduce__`` and ``__setstate__``."""
    return kind.__module__.startswith(_CORE)


def _state_of_twin(found: Any) -> Any:
    try:
        reduced = found.__reduce__()
    except TypeError:  # one without a memory need not say so
        return None
    return reduced[2] if len(reduced) > 2 else None


@_by_type
def _is_instance(kind: Any) -> bool:
    """Whether what an object holds is in its attributes."""
    others = (*_CONTAINERS, *CONSTANT, *_GENERATORS, *_KNOWN)
    return not issubclass(kind, others) and not _is_of_core(kind) and not _has_pair(kind) and _is_python(kind)


def _is_python(kind: type) -> bool:
    """Whether all that instances hold are attributes: no class above it but ``object`` is an extension type."""
    above = [each for each in kind.__mro__ if each is not object]
    is_compiled = (isinstance(vars(each).get("__new__"), BuiltinFunctionType) for each in above)
    return all(each.__flags__ & _HEAP_TYPE for each in above) and not any(is_compiled)


def _has_pair(kind: type) -> bool:
    """Whether objects say themselves what they remember."""
    return callable(getattr(kind, "state", None)) and callable(getattr(kind, "restore", None))


def _attributes(found: Any) -> dict[str, Any]:
    """Attributes of an instance by name, in the order of :func:`gc.get_referents`."""
    in_slots = {name: getattr(found, name) for name in _slots(type(found)) if hasattr(found, name)}
    return in_slots | getattr(found, "__dict__", {})


@_by_type
def _slots(kind: Any) -> tuple[str, ...]:
    """Names of the slots of a class and of those above it."""
    return tuple(name for each in kind.__mro__ for name in _slots_of(each))


def _slots_of(kind: type) -> tuple[str, ...]:
    slots = vars(kind).get("__slots__", ())
    names = (slots,) if isinstance(slots, str) else tuple(slots)
    hidden = (
        f"_{kind.__name__.lstrip('_')}{name}" if name.startswith("__") and not name.endswith("__") else name
        for name in names
    )
    return tuple(name for name in sorted(hidden) if name not in ("__dict__", "__weakref__"))
