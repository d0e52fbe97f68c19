"""What an object of a simulation holds and remembers."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from enum import Enum
from functools import partial
from types import FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.config import StrictModel
from ffsm_mj.model.system import System
from ffsm_mj.records.sampler import Sampler
from ffsm_mj.simulation.mujoco_memory import DATA, MODEL

CONSTANT = (tuple, frozenset, MappingProxyType, FunctionType, MethodType, partial, StrictModel, System, Sampler)
"""Types whose instances remember nothing themselves; what they hold may."""
_CONTAINERS = (list, dict, set, deque)
_TWINS = "ffsm_mj_fast"
_HEAP_TYPE = 1 << 9
"""Flag of types that a class statement makes."""


class Changed(dict[str, Any]):
    """Some of the attributes of an object, which keeps the others."""


def is_walked(found: Any) -> bool:
    """Whether an object has a number; others, as numbers, texts and random generators, are pickled where they are held."""
    if isinstance(found, (type, ModuleType, Enum, BaseException)):
        return False
    known = isinstance(found, (*_CONTAINERS, *CONSTANT, np.ndarray, mujoco.MjModel, mujoco.MjData))
    return known or _is_twin(found) or (_is_python(type(found)) and bool(_attributes(found)))


def parts(found: Any) -> Iterator[tuple[str, Any]]:
    """What an object holds, with its place in it."""
    if isinstance(found, System):
        yield ".mj", found.mj
    elif isinstance(found, (StrictModel, Sampler, set, frozenset)) or _has_pair(found):
        return  # a set holds numbers and names, in an order that is not the same in every process
    elif isinstance(found, (dict, MappingProxyType)):
        yield from ((f"[{key!r}]", part) for key, part in found.items())
    elif isinstance(found, (list, tuple, deque)) or (isinstance(found, np.ndarray) and found.dtype == object):
        yield from ((f"[{i}]", part) for i, part in enumerate(found))
    elif isinstance(found, FunctionType):
        yield from ((f".{i}", cell.cell_contents) for i, cell in enumerate(found.__closure__ or ()) if _is_filled(cell))
    elif isinstance(found, MethodType):
        yield ".__self__", found.__self__
    elif isinstance(found, partial):
        yield from ((f".{i}", part) for i, part in enumerate((found.func, *found.args, *found.keywords.values())))
    elif not isinstance(found, (np.ndarray, mujoco.MjModel, mujoco.MjData)):
        yield from ((f".{name}", part) for name, part in _attributes(found).items())


def _is_filled(cell: Any) -> bool:
    try:
        return cell.cell_contents is not None
    except ValueError:
        return False


def content_of(found: Any) -> Any:
    """What an object remembers."""
    if isinstance(found, mujoco.MjData):
        return DATA.content(found)
    if isinstance(found, mujoco.MjModel):
        return MODEL.content(found)
    if isinstance(found, np.ndarray):
        return found.copy() if found.flags.writeable else None
    if isinstance(found, _CONTAINERS):
        return dict(found) if isinstance(found, dict) else list(found)
    if _is_twin(found):
        return _state_of_twin(found)
    return found.state() if _has_pair(found) else _attributes(found)


def write(found: Any, content: Any) -> None:
    """Write into an object what it remembered."""
    if isinstance(found, mujoco.MjData):
        DATA.write(found, content)
    elif isinstance(found, mujoco.MjModel):
        MODEL.write(found, content)
    elif isinstance(found, np.ndarray):
        if content is not None:
            found[...] = content
    elif isinstance(found, _CONTAINERS):
        _fill(found, content)
    elif _is_twin(found):
        if content is not None:
            found.__setstate__(content)
    elif _has_pair(found):
        found.restore(content)
    else:
        if not isinstance(content, Changed):
            for name in _attributes(found).keys() - content.keys():
                object.__delattr__(found, name)
        for name, value in content.items():
            object.__setattr__(found, name, value)


def _fill(container: list[Any] | dict[Any, Any] | set[Any] | deque[Any], content: Any) -> None:
    container.clear()
    if isinstance(container, (list, deque)):
        container.extend(content)
    else:
        container.update(content)


def _is_twin(found: Any) -> bool:
    """Whether an object is compiled; one with a memory says so by ``__reduce__`` and ``__setstate__``."""
    return type(found).__module__.startswith(_TWINS)


def _state_of_twin(found: Any) -> Any:
    try:
        reduced = found.__reduce__()
    except TypeError:  # one without a memory need not say so
        return None
    return reduced[2] if len(reduced) > 2 else None


def _is_python(kind: type) -> bool:
    """Whether all that instances hold are attributes: no class above it but ``object`` is an extension type."""
    return all(each.__flags__ & _HEAP_TYPE for each in kind.__mro__ if each is not object)


def _has_pair(found: Any) -> bool:
    """Whether an object says itself what it remembers."""
    return callable(getattr(type(found), "state", None)) and callable(getattr(type(found), "restore", None))


def _attributes(found: Any) -> dict[str, Any]:
    """Attributes of an instance by name; none of one that has only those of its class."""
    slots = (name for each in type(found).__mro__ for name in _slots_of(each))
    return {**getattr(found, "__dict__", {}), **{name: getattr(found, name) for name in slots if hasattr(found, name)}}


def _slots_of(kind: type) -> tuple[str, ...]:
    slots = vars(kind).get("__slots__", ())
    names = (slots,) if isinstance(slots, str) else tuple(slots)
    hidden = (
        f"_{kind.__name__.lstrip('_')}{name}" if name.startswith("__") and not name.endswith("__") else name
        for name in names
    )
    return tuple(name for name in hidden if name not in ("__dict__", "__weakref__"))
