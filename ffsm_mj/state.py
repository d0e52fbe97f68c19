"""State of a simulation: what its parts remember, as data that any process and any machine can read.

A part that remembers has a small dataclass ``State`` and the pair of methods ``get_state()`` and ``set_state(state)``. A
state holds numbers, texts, arrays, and tuples, lists, sets and mappings of these; states of other parts are fields of it.
:func:`to_bytes` and :func:`from_bytes` write and read it as JSON, in which arrays are base64: nothing is executed when a
state is read. Where it was read, the states of parts are mappings, which every :meth:`Stateful.set_state` takes too.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from functools import partial
from hashlib import sha256
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.errors import FfsmError

FORMAT = "ffsm-state 1"
"""Name and version of the format; the first line of a state is this and a digest of the rest."""
_KINDS = "fiub"
"""Kinds of NumPy's types that arrays of a state may have: numbers."""
_SCALARS = (bool, int, float, str, type(None))
_IN_PLACE = {"FloatArray": FloatArray, "IntArray": IntArray, "BoolArray": BoolArray}
"""Annotations of arrays of a fixed shape: others hold views of them, so that they are written in place."""
_PLAIN = {"float": float, "int": int, "bool": bool, "str": str}
"""Annotations of single values, which are checked."""
_CONTAINERS: dict[str, Any] = {"list": list, "tuple": (tuple, list), "dict": Mapping, "set": Set, "frozenset": Set}
"""The same of containers."""


class StateError(FfsmError):
    """What a part remembers cannot be saved, or a state does not fit the simulation."""


@runtime_checkable
class HasState(Protocol):
    """A part that says itself what it remembers."""

    def get_state(self) -> Any:
        """What it remembers: numbers, texts, arrays, and containers of these."""

    def set_state(self, state: Any) -> None:
        """Take back what :meth:`get_state` gave, maybe in another process."""


class Stateful:
    """A part whose state is some of its attributes: those that the fields of ``State`` name, private or not.

    An attribute that is a part with a state of its own contributes that; so does each entry of a sequence or mapping of such
    parts. A field of type ``FloatArray``, ``IntArray`` or ``BoolArray`` is an array of a fixed shape, written in place; any
    other attribute is replaced.
    """

    State: ClassVar[type[Any]]

    def get_state(self) -> Any:
        """What it remembers: a ``State`` of its own, which shares nothing with the part."""
        return self.State(**{name: _told(getattr(self, own)) for name, own, _ in _attributes(type(self), self)})

    def set_state(self, state: Any) -> None:
        """Take back a state; one that was read from bytes is a mapping.

        Raises:
            StateError: It does not fit.
        """
        told = entries(state, [each.name for each in fields(self.State)], type(self).__qualname__)
        for name, own, kind in _attributes(type(self), self):
            where = f"{type(self).__qualname__}.{name}"
            present = getattr(self, own)
            if not _set_parts(present, told[name], where):
                # Frozen dataclasses have a state too.
                object.__setattr__(self, own, _written(present, told[name], kind, where))


def _attributes(kind: type[Any], part: Any) -> list[tuple[str, str, str]]:
    """Fields of the state of a part: name, attribute, and annotation, be it evaluated or not."""
    known = _IN_PLACE | _PLAIN
    return [
        (
            each.name,
            f"_{each.name}" if hasattr(part, f"_{each.name}") else each.name,
            next((name for name, annotation in known.items() if each.type in (name, annotation)), str(each.type)),
        )
        for each in fields(kind.State)
    ]


def entries(state: Any, names: Sequence[str], where: str) -> Mapping[str, Any]:
    """The entries of a state by name.

    Args:
        state: A dataclass, or the mapping that was read of one.
        names: Names that it must have, and no others.
        where: Whose state it is, for messages.

    Raises:
        StateError: It has others.
    """
    told = {each.name: getattr(state, each.name) for each in fields(state)} if is_dataclass(state) else state
    if not isinstance(told, Mapping) or set(told) != set(names):
        has = f"has {', '.join(map(str, told))}" if isinstance(told, Mapping) else f"is {type(told).__name__}"
        raise StateError(f"state of {where}: needs {', '.join(names)}, but {has}")
    return told


def as_mappings(state: Any) -> Any:
    """A state with mappings in place of dataclasses, as one that was read from bytes."""
    if is_dataclass(state) and not isinstance(state, type):
        return {each.name: as_mappings(getattr(state, each.name)) for each in fields(state)}
    return {key: as_mappings(each) for key, each in state.items()} if isinstance(state, Mapping) else state


def get_states(parts: Mapping[str, Any]) -> dict[str, Any]:
    """States of some parts by name."""
    return {name: part.get_state() for name, part in parts.items()}


def set_states(parts: Mapping[str, Any], states: Any, where: str) -> None:
    """Set the states of some parts by name.

    Raises:
        StateError: The names, or a state, do not fit.
    """
    told = entries(states, [*parts], where)
    for name, part in parts.items():
        part.set_state(told[name])


def fitting(told: Any, shape: tuple[int, ...], where: str) -> npt.NDArray[Any]:
    """An array of a state, of a shape.

    Raises:
        StateError: It is none.
    """
    if not isinstance(told, np.ndarray) or told.shape != shape:
        has = f"shape {told.shape}" if isinstance(told, np.ndarray) else type(told).__name__
        raise StateError(f"state of {where}: needs an array of shape {shape}, but has {has}")
    return told


def _told(value: Any) -> Any:
    """A value as it is told, sharing nothing with the part."""
    if hasattr(value, "get_state"):
        return value.get_state()
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, Mapping):
        return {key: _told(each) for key, each in value.items()}
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return tuple(map(_told, value))
    if isinstance(value, (list, tuple, set, frozenset)):
        return type(value)(map(_told, value))
    return list(map(_told, value)) if isinstance(value, deque) else value


def _set_parts(present: Any, told: Any, where: str) -> bool:
    """Set the states of an attribute that is a part, or of those in a sequence or mapping; returns whether it is one."""
    if hasattr(present, "set_state"):
        present.set_state(told)
        return True
    if isinstance(present, Mapping) and present and all(hasattr(each, "set_state") for each in present.values()):
        set_states(present, told, where)
        return True
    if isinstance(present, (list, tuple)) and present and all(hasattr(each, "set_state") for each in present):
        if not isinstance(told, Sequence) or len(told) != len(present):
            raise StateError(f"state of {where}: needs {len(present)} entries")
        for part, state in zip(present, told, strict=True):
            part.set_state(state)
        return True
    return False


def _written(present: Any, told: Any, kind: str, where: str) -> Any:
    """The value of an attribute that was told: the present array with other numbers, or another value."""
    if kind in _IN_PLACE:
        present[...] = fitting(told, present.shape, where)
        return present
    if kind in _PLAIN and not isinstance(told, (float, int) if kind == "float" else _PLAIN[kind]):
        raise StateError(f"state of {where}: needs {kind}, but has {type(told).__name__}")
    container = "" if "None" in kind else kind.partition("[")[0]
    if not isinstance(told, _CONTAINERS.get(container, object)):
        raise StateError(f"state of {where}: needs {container}, but has {type(told).__name__}")
    return _taken(present, told)


def _taken(present: Any, told: Any) -> Any:
    """A value of a state as an attribute: a copy, so that the state stays as it is."""
    if isinstance(present, deque):
        return deque(map(_told, told), present.maxlen)
    if isinstance(present, (set, frozenset)):
        return type(present)(told)
    if isinstance(present, tuple) and hasattr(present, "_fields") and isinstance(told, Sequence):
        return type(present)(*map(_told, told))
    return _told(told)


def to_bytes(state: Any) -> bytes:
    """A state as bytes: a line with format and digest, then JSON.

    Raises:
        StateError: It holds something else than numbers, texts, arrays and containers of these.
    """
    try:
        text = json.dumps(_plain(state, ""), separators=(",", ":"), allow_nan=False).encode()
    except (ValueError, RecursionError) as error:  # of thousands of digits, or nested without end
        raise StateError(f"a state cannot be written: {error}") from error
    return f"{FORMAT} {_digest(text)}\n".encode() + text


def from_bytes(data: bytes) -> Any:
    """A state from bytes: mappings in place of dataclasses.

    Raises:
        StateError: They are no state of this version.
    """
    first, _, rest = data.partition(b"\n")
    format_, _, digest = first.decode(errors="replace").rpartition(" ")
    if format_ != FORMAT:
        raise StateError(f"no state of the format {FORMAT!r}: it begins with {first[:40].decode(errors='replace')!r}")
    # The parts check what they are set to as far as they must; a state whose numbers were changed is none of this program.
    if digest != _digest(rest):
        raise StateError("a state that is damaged: its content is not that of its digest")
    try:
        return _read(json.loads(rest))
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError, binascii.Error) as error:
        raise StateError(f"a state that is damaged: {error}") from error


def _digest(text: bytes) -> str:
    return sha256(text).hexdigest()[:32]


def _plain(value: Any, where: str) -> Any:
    """A value in JSON; whatever JSON lacks is an object with one key that begins with $."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return {"$float": repr(value)}
    if isinstance(value, _SCALARS):
        return value
    if is_dataclass(value) and not isinstance(value, type):
        value = {each.name: getattr(value, each.name) for each in fields(value)}
    for kind, plain in _WRITERS.items():
        if isinstance(value, kind):
            return plain(value, where)
    raise StateError(f"state{where}: {type(value).__name__} is no number, text, array, or container of these")


def _plain_array(value: npt.NDArray[Any], where: str) -> Any:
    if value.dtype.kind not in _KINDS:
        raise StateError(f"state{where}: an array of {value.dtype}, not of numbers")
    data = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
    return {"$array": [data.dtype.str, list(value.shape), base64.b64encode(data.tobytes()).decode()]}


def _plain_mapping(value: Mapping[Any, Any], where: str) -> Any:
    if all(isinstance(key, str) and not key.startswith("$") for key in value):
        return {key: _plain(each, f"{where}.{key}") for key, each in value.items()}
    return {"$map": [[_plain(key, where), _plain(each, f"{where}[{key!r}]")] for key, each in value.items()]}


def _plain_list(value: Sequence[Any], where: str) -> list[Any]:
    return [_plain(each, f"{where}[{i}]") for i, each in enumerate(value)]


def _plain_set(value: Set[Any], where: str) -> Any:
    return {"$set": sorted(_plain_list([*value], where), key=json.dumps)}  # in an order that is the same in every process


_WRITERS: dict[type[Any], Callable[[Any, str], Any]] = {
    np.ndarray: _plain_array,
    bytes: lambda value, _: {"$bytes": base64.b64encode(value).decode()},
    Mapping: _plain_mapping,
    tuple: lambda value, where: {"$tuple": _plain_list(value, where)},
    Set: _plain_set,
    list: _plain_list,
}
"""How containers, arrays and bytes are written, by type."""


def _read_array(told: Any) -> npt.NDArray[Any]:
    dtype, shape, data = told
    kind = np.dtype(str(dtype))
    if kind.kind not in _KINDS:
        raise ValueError(f"an array of {kind}")
    native = np.frombuffer(base64.b64decode(data, validate=True), kind).astype(kind.newbyteorder("="))
    return native.reshape([int(each) for each in shape])


_READERS: dict[str, Callable[[Any], Any]] = {
    "$float": lambda told: {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}[told],
    "$array": _read_array,
    "$bytes": partial(base64.b64decode, validate=True),
    "$map": lambda told: {_read(key): _read(each) for key, each in told},
    "$tuple": lambda told: tuple(map(_read, told)),
    "$set": lambda told: frozenset(map(_read, told)),
}


def _read(told: Any) -> Any:
    if isinstance(told, list):
        return [_read(each) for each in told]
    if not isinstance(told, dict):
        return told
    name = next(iter(told), "")
    if len(told) == 1 and name.startswith("$"):
        return _READERS[name](told[name])
    return {key: _read(each) for key, each in told.items()}
