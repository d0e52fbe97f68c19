"""Classes by kind: built-in ones, and those that other packages offer through an entry-point group."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from ffsm_mj.controller_protocol import StrictModel


@dataclass(frozen=True)
class Kinds:
    """What a scenario may ask for.

    Attributes:
        classes: Class by kind; each has a ``Config``.
        broken: Why a plugin could not be used, by kind.
    """

    classes: dict[str, Any]
    broken: dict[str, str]


def installed(group: str, built_in: Iterable[Any], noun: str) -> Kinds:
    """Built-in classes and those of installed plugins; a broken plugin harms only the scenarios that ask for it.

    Args:
        group: Entry-point group.
        built_in: Classes of this package.
        noun: What they are, for messages.
    """
    own = {_kind_of(cls): cls for cls in built_in}
    found = Kinds(dict(own), {})
    for entry_point in entry_points(group=group):
        if entry_point.name in own:
            found.broken[entry_point.name] = f"{entry_point.value} has the name of a built-in {noun}; rename it"
            continue
        try:
            found.classes[entry_point.name] = _load(entry_point)
        except Exception as error:  # noqa: BLE001 (a plugin may fail in any way)
            found.broken[entry_point.name] = f"{type(error).__name__}: {error}"
    return found


def _load(entry_point: EntryPoint) -> Any:
    cls = entry_point.load()
    config = getattr(cls, "Config", None)
    if not (isinstance(config, type) and issubclass(config, StrictModel)):
        raise TypeError(
            f"{entry_point.value} has no class attribute Config derived from ffsm_mj.controller_protocol.StrictModel"
        )
    config.model_rebuild()  # otherwise built with all others at the first use: a fault of it would harm every scenario
    if _kind_of(cls) != entry_point.name:
        raise TypeError(f"{entry_point.value}: the entry point's name must be the kind {_kind_of(cls)!r}")
    return cls


def _kind_of(cls: Any) -> str:
    """The one value of the field ``kind``."""
    values = cls.Config.model_fields["kind"].annotation.__args__
    return str(values[0])
