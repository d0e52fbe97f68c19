"""Memory of a simulation: everything that its parts remember between two steps, saved and restored in place.

The parts are found by walking the objects that can be reached from the simulation as it is assembled: no part can forget to
mention something. Assembly is deterministic, so that an object is known by its number in the walk, also in another process.
A state holds the contents of these objects by number; what a run has created since is pickled with them.

What cannot be pickled (extension types, and plug-ins with a resource such as a file) says what it remembers by one pair of
methods, ``state()`` and ``restore(state)``. What is held by a class or a module is not of the state.
"""

from __future__ import annotations

import io
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any

from ffsm_mj.errors import FfsmError, described
from ffsm_mj.simulation.array_blocks import ArrayBlocks
from ffsm_mj.simulation.object_contents import CONSTANT, Changed, content_of, is_lost, is_walked, parts, place_in, write
from ffsm_mj.simulation.state_pickler import StatePickler, StateUnpickler

_WHOLE = ""
_PAIR = "the methods state() and restore(state)"
_ELSEWHERE = f"hold it in an object with {_PAIR}"


class StateError(FfsmError):
    """What a part remembers cannot be saved, or does not fit the simulation."""


class Memory:
    """The objects of a simulation as assembled."""

    def __init__(self, outside: Sequence[Any], **roots: Any) -> None:
        """Walk the objects that can be reached from some parts, before their first step.

        Args:
            outside: Objects whose contents are not of the state; those that they hold are not reached through them.
            roots: Parts by name.
        """
        self._objects = list(outside)
        self._holders: list[int | str] = [type(each).__qualname__ for each in outside]
        self._numbers = {id(each): number for number, each in enumerate(outside)}
        self._outside, self._lost = len(outside), list[tuple[int, Any]]()
        todo = deque[tuple[int | str, Any]](roots.items())
        while todo:
            holder, found = todo.popleft()
            if id(found) in self._numbers or not is_walked(found):
                continue
            number = self._numbers[id(found)] = len(self._objects)
            self._objects.append(found)
            self._holders.append(holder)
            held = list(parts(found))
            todo.extend((number, part) for part in held)
            if isinstance(found, CONSTANT):
                self._lost += [(number, part) for part in held if is_lost(part)]

    @property
    def structure(self) -> tuple[str, ...]:
        """Types of the objects of the state, in the order of the walk: equal for simulations of one scenario."""
        return tuple(type(each).__qualname__ for each in self._objects[self._outside :])

    def save(self) -> bytes:
        """What the objects remember.

        Raises:
            StateError: One holds what cannot be saved.
        """
        with self._named():
            return self._pickled([(number, content_of(each)) for number, each in self._changing()])

    @cached_property
    def _blocks(self) -> ArrayBlocks:
        return ArrayBlocks(self._objects)

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Say what cannot be saved.

        Raises:
            StateError: Something cannot.
        """
        if self._lost:
            holder, part = self._lost[0]
            where = self._place(holder) + place_in(self._objects[holder], part)
            raise StateError(f"{where} ({type(part).__name__}) cannot be saved where it is: {_ELSEWHERE}")
        try:
            yield
        except Exception as error:
            raise StateError(self._culprit() or described(error)) from error

    def note(self) -> None:
        """Note the present contents: :meth:`save_changed` saves what differs from them.

        Raises:
            StateError: An object holds what cannot be saved.
        """
        with self._named():
            self._noted = {(number, key): self._pickled(value) for number, key, value in self._items()}

    def save_changed(self) -> bytes:
        """What the objects remember, as far as it has changed since :meth:`note`.

        What a scenario sets is not among it: restored into a simulation with other settings, the state leaves these alone.

        Raises:
            StateError: An object holds what cannot be saved.
        """
        changed: dict[int, Any] = {}
        with self._named():
            for number, key, value in self._items():
                if self._noted.get((number, key)) == self._pickled(value):
                    continue
                if key == _WHOLE:
                    changed[number] = value
                else:
                    changed.setdefault(number, Changed())[key] = value
            return self._pickled(list(changed.items()))

    def _items(self) -> Iterator[tuple[int, Any, Any]]:
        """Contents by number: attribute by attribute, or as a whole."""
        for number, each in self._changing():
            content = content_of(each)
            if isinstance(content, dict) and not isinstance(each, dict):
                yield from ((number, name, value) for name, value in content.items())
            else:
                yield number, _WHOLE, content

    def restore(self, saved: bytes) -> None:
        """Write what the objects remembered back into them; nothing is written if it cannot be read."""
        unpickler = StateUnpickler(io.BytesIO(saved), self._objects)
        for number, content in unpickler.load():
            write(self._objects[number], content)

    def _changing(self) -> Iterator[tuple[int, Any]]:
        """Objects that change in a run, with their numbers."""
        for number, each in enumerate(self._objects):
            if number >= self._outside and not isinstance(each, CONSTANT):
                yield number, each

    def _pickled(self, what: Any) -> bytes:
        file = io.BytesIO()
        StatePickler(file, self._numbers, self._blocks).dump(what)
        return file.getvalue()

    def _place(self, number: int) -> str:
        """Place of an object, from the part that leads to it."""
        holder = self._holders[number]
        if isinstance(holder, str):
            return holder
        return self._place(holder) + place_in(self._objects[holder], self._objects[number])

    def _culprit(self) -> str:
        """Which attribute of which object cannot be saved."""
        for number, each in self._changing():
            content = content_of(each)
            for name, value in content.items() if isinstance(content, dict) else [("", content)]:
                try:
                    self._pickled(value)
                except Exception as error:  # noqa: BLE001 (whatever a value's type raises)
                    where = self._place(number) + (f".{name}" if name else "")
                    can_have = type(each).__module__ != "builtins"
                    pair = f"give {type(each).__qualname__} {_PAIR}" if can_have else _ELSEWHERE
                    return f"{where} cannot be saved ({described(error)}): {pair}"
        return ""
