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
        return self.State(
            **{name: _copied(getattr(self, attribute)) for name, attribute, _ in _attributes(type(self), self)}
        )

    def set_state(self, state: Any) -> None:
        """Take back a state; one that was read from bytes is a mapping.

        Raises:
            StateError: It does not fit.
        """
        values = entries(state, self.State, type(self).__qualname__)
        for name, attribute, kind in _attributes(type(self), self):
            where = f"{type(self).__qualname__}.{name}"
            present = getattr(self, attribute)
            if not _set_parts(present, values[name], where):
                # Frozen dataclasses have a state too.
                object.__setattr__(self, attribute, _written(present, values[name], kind, where))


def _attributes(kind: type[Any], part: Any) -> list[tuple[str, str, str]]:
    """Fields of the state of a part: name, attribute, and annotation, be it evaluated or not."""
    known = _IN_PLACE | _PLAIN
    return [
        (
            field.name,
            f"_{field.name}" if hasattr(part, f"_{field.name}") else field.name,
            next((name for name, annotation in known.items() if field.type in (name, annotation)), str(field.type)),
        )
        for field in fields(kind.State)
    ]


def entries(state: Any, needed: type[Any] | Sequence[str], where: str = "") -> Mapping[str, Any]:
    """The entries of a state by name.

    Args:
        state: A dataclass, or the mapping that was read of one.
        needed: The class of the state, or the names that it must have, and no others.
        where: Whose state it is, for messages; by default the class in which that of the state is.

    Raises:
        StateError: It has others.
    """
    if isinstance(needed, type):
        names, where = [field.name for field in fields(needed)], where or needed.__qualname__.rpartition(".")[0]
    else:
        names = list(needed)
    values = {field.name: getattr(state, field.name) for field in fields(state)} if is_dataclass(state) else state
    if not isinstance(values, Mapping) or set(values) != set(names):
        has = f"has {', '.join(map(str, values))}" if isinstance(values, Mapping) else f"is {type(values).__name__}"
        raise StateError(f"state of {where}: needs {', '.join(names)}, but {has}")
    return values


def as_mappings(state: Any) -> Any:
    """A state with mappings in place of dataclasses, as one that was read from bytes."""
    if is_dataclass(state) and not isinstance(state, type):
        return {field.name: as_mappings(getattr(state, field.name)) for field in fields(state)}
    return {key: as_mappings(part) for key, part in state.items()} if isinstance(state, Mapping) else state


def get_states(parts: Mapping[str, Any]) -> dict[str, Any]:
    """States of some parts by name."""
    return {name: part.get_state() for name, part in parts.items()}


def set_states(parts: Mapping[str, Any], states: Any, where: str) -> None:
    """Set the states of some parts by name.

    Raises:
        StateError: The names, or a state, do not fit.
    """
    values = entries(states, [*parts], where)
    for name, part in parts.items():
        part.set_state(values[name])


def fitting(values: Any, shape: tuple[int, ...], where: str) -> npt.NDArray[Any]:
    """An array of a state, of a shape.

    Raises:
        StateError: It is none.
    """
    if not isinstance(values, np.ndarray) or values.shape != shape:
        has = f"shape {values.shape}" if isinstance(values, np.ndarray) else type(values).__name__
        raise StateError(f"state of {where}: needs an array of shape {shape}, but has {has}")
    return values


def _copied(value: Any) -> Any:
    """A value as it is told, sharing nothing with the part."""
    if hasattr(value, "get_state"):
        return value.get_state()
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, Mapping):
        return {key: _copied(part) for key, part in value.items()}
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return tuple(map(_copied, value))
    if isinstance(value, (list, tuple, set, frozenset)):
        return type(value)(map(_copied, value))
    return list(map(_copied, value)) if isinstance(value, deque) else value


def _set_parts(present: Any, saved: Any, where: str) -> bool:
    """Set the states of an attribute that is a part, or of those in a sequence or mapping; returns whether it is one."""
    if hasattr(present, "set_state"):
        present.set_state(saved)
        return True
    if isinstance(present, Mapping) and present and all(hasattr(one, "set_state") for one in present.values()):
        set_states(present, saved, where)
        return True
    if isinstance(present, (list, tuple)) and present and all(hasattr(one, "set_state") for one in present):
        if not isinstance(saved, Sequence) or len(saved) != len(present):
            raise StateError(f"state of {where}: needs {len(present)} entries")
        for part, state in zip(present, saved, strict=True):
            part.set_state(state)
        return True
    return False


def _written(present: Any, saved: Any, kind: str, where: str) -> Any:
    """The value of an attribute that was told: the present array with other numbers, or another value."""
    if kind in _IN_PLACE:
        present[...] = fitting(saved, present.shape, where)
        return present
    if kind in _PLAIN and not isinstance(saved, (float, int) if kind == "float" else _PLAIN[kind]):
        raise StateError(f"state of {where}: needs {kind}, but has {type(saved).__name__}")
    container = "" if "None" in kind else kind.partition("[")[0]
    if not isinstance(saved, _CONTAINERS.get(container, object)):
        raise StateError(f"state of {where}: needs {container}, but has {type(saved).__name__}")
    return _as_attribute(present, saved)


def _as_attribute(present: Any, saved: Any) -> Any:
    """A value of a state as an attribute: a copy, so that the state stays as it is."""
    if isinstance(present, deque):
        return deque(map(_copied, saved), present.maxlen)
    if isinstance(present, (set, frozenset)):
        return type(present)(saved)
    if isinstance(present, tuple) and hasattr(present, "_fields") and isinstance(saved, Sequence):
        return type(present)(*map(_copied, saved))
    return _copied(saved)


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
        value = {field.name: getattr(value, field.name) for field in fields(value)}
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
        return {key: _plain(part, f"{where}.{key}") for key, part in value.items()}
    return {"$map": [[_plain(key, where), _plain(part, f"{where}[{key!r}]")] for key, part in value.items()]}


def _plain_list(value: Sequence[Any], where: str) -> list[Any]:
    return [_plain(part, f"{where}[{i}]") for i, part in enumerate(value)]


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


def _read_array(saved: Any) -> npt.NDArray[Any]:
    dtype, shape, data = saved
    kind = np.dtype(str(dtype))
    if kind.kind not in _KINDS:
        raise ValueError(f"an array of {kind}")
    native = np.frombuffer(base64.b64decode(data, validate=True), kind).astype(kind.newbyteorder("="))
    return native.reshape([int(length) for length in shape])


_READERS: dict[str, Callable[[Any], Any]] = {
    "$float": lambda data: {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}[data],
    "$array": _read_array,
    "$bytes": partial(base64.b64decode, validate=True),
    "$map": lambda data: {_read(key): _read(value) for key, value in data},
    "$tuple": lambda data: tuple(map(_read, data)),
    "$set": lambda data: frozenset(map(_read, data)),
}


def _read(data: Any) -> Any:
    if isinstance(data, list):
        return [_read(part) for part in data]
    if not isinstance(data, dict):
        return data
    name = next(iter(data), "")
    if len(data) == 1 and name.startswith("$"):
        return _READERS[name](data[name])
    return {key: _read(part) for key, part in data.items()}
