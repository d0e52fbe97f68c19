"""States of plug-ins: of those that say theirs, by name; those that say nothing must not remember, and whether they do."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Set
from contextlib import contextmanager, suppress
from enum import Enum
from functools import partial
from random import Random
from re import Pattern
from types import BuiltinMethodType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from ffsm_mj.errors import described
from ffsm_mj.state import HasState, StateError, Stateful, from_bytes, to_bytes

_SINGLE = (
    bool,
    int,
    float,
    complex,
    str,
    bytes,
    type(None),
    type,
    slice,
    range,
    np.generic,
    np.dtype,
    np.ufunc,
    Enum,
    ModuleType,
    Pattern,
)
_OPAQUE = object()
"""What cannot be looked into, as a generator: it may change unseen."""


class Unchanging:
    """A part without a state of its own: a plug-in that has no ``get_state`` and ``set_state``, and so must not remember.

    What it holds is looked at as it is made, and compared whenever a state is asked for or set.
    """

    def __init__(self, part: Any, name: str) -> None:
        """Look at a part before its first use; ``name`` is for messages."""
        self._part, self._name = part, name
        self._before = dict(_contents(part, {id(part): part}))

    def get_state(self) -> None:
        """Nothing.

        Raises:
            StateError: Something that it holds has changed.
        """
        now = dict(_contents(self._part, {id(self._part): self._part}))
        changed = next((name for name in {**self._before, **now} if _differs(self._before.get(name), now.get(name))), None)
        if changed is not None:
            pair, kind = "get_state() and set_state(state)", type(self._part).__qualname__
            raise StateError(f"{self._name} remembers {changed!r}, and no state has it: give {kind} {pair}")

    def set_state(self, state: Any) -> None:  # noqa: ARG002
        """Nothing, if nothing has changed.

        Raises:
            StateError: Something has.
        """
        self.get_state()


class Named:
    """A part that says itself what it remembers: faults have its name, and its state shares nothing with it."""

    def __init__(self, part: HasState, name: str) -> None:
        """Wrap a part; ``name`` is for messages."""
        self._part, self._name = part, name

    def get_state(self) -> Any:
        """What it remembers, as it is read from bytes.

        Raises:
            StateError: It cannot be written, or the part raises something.
        """
        with self._named("get_state"):
            return from_bytes(to_bytes(self._part.get_state()))

    def set_state(self, state: Any) -> None:
        """Hand a state to the part.

        Raises:
            StateError: The part raises something.
        """
        with self._named("set_state"):
            self._part.set_state(state)

    @contextmanager
    def _named(self, method: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # whatever a plug-in raises
            raise StateError(f"{self._name}, {method}: {described(error)}") from error


def with_state(part: Any, name: str) -> HasState:
    """What has the state of a part: itself, or what stands for it if it is no :class:`~ffsm_mj.state.Stateful`."""
    if isinstance(part, Stateful):
        return part
    return Named(part, name) if isinstance(part, HasState) else Unchanging(part, name)


def _differs(one: Any, other: Any) -> bool:
    return _OPAQUE in (one, other) or one != other


def _contents(part: Any, seen: dict[int, Any]) -> Iterator[tuple[str, Any]]:
    """What a part holds, by attribute, in a form that can be compared."""
    slots = (name for kind in type(part).__mro__ for name in (*vars(kind).get("__slots__", ()),))
    for name in dict.fromkeys((*getattr(part, "__dict__", {}), *slots)):
        if hasattr(part, name) and name not in ("__dict__", "__weakref__"):
            yield name, _form(getattr(part, name), seen)


def _form(value: Any, seen: dict[int, Any]) -> Any:
    """A value in a form that can be compared: copies of numbers; the identity of what belongs to the simulation.

    Args:
        value: The value.
        seen: Values so far by identity, which are kept: another one would have the identity of one that is gone.
    """
    if isinstance(value, _SINGLE):
        return repr(value)
    if id(value) in seen:
        return ("again", type(value).__qualname__)
    seen[id(value)] = value
    for kind, inside in _INSIDE:
        if isinstance(value, kind):
            items = dict(_contents(value, seen)) if isinstance(value, (list, dict)) else {}
            return (*(_form(part, seen) for part in inside(value)), *items.items())
    if _belongs_to_simulation(type(value)):
        return id(value)
    contents = tuple(_contents(value, seen))
    return contents if contents or hasattr(value, "__dict__") else _OPAQUE


_INSIDE: tuple[tuple[Any, Callable[[Any], Any]], ...] = (
    (np.ndarray, lambda value: value.tolist() if value.dtype == object else (value.shape, value.tobytes())),
    (Mapping, lambda value: (part for item in value.items() for part in item)),
    (Set, lambda value: sorted(map(repr, value))),
    ((list, tuple, deque), iter),
    (np.random.Generator, lambda value: [value.bit_generator.state]),
    (np.random.RandomState, lambda value: value.get_state()),
    (Random, lambda value: value.getstate()),
    (partial, lambda value: (value.func, value.args, value.keywords)),
    (MethodType, lambda value: [value.__self__]),
    (BuiltinMethodType, lambda value: [value.__self__]),
    (FunctionType, lambda value: (_cells(value), value.__defaults__, value.__kwdefaults__)),
)
"""What values hold, by type; of others their attributes count."""


def _cells(function: FunctionType) -> list[Any]:
    """What a function has bound of the variables of others."""
    cells = []
    for cell in function.__closure__ or ():
        with suppress(ValueError):  # it has no value yet
            cells.append(cell.cell_contents)
    return cells


def _belongs_to_simulation(kind: type[Any]) -> bool:
    """Whether what an object of a class remembers is not the part's: configurations, models, MuJoCo's data.

    A law inside another one is a part of that, though its class may derive from :class:`~ffsm_mj.state.Stateful`.
    """
    above = {base.__module__.partition(".")[0] for base in kind.__mro__ if base not in (object, Stateful)}
    return bool(above & {"ffsm_mj", "mujoco", "pydantic", "logging"})
