"""Classes by kind: built-in ones, and those that other packages offer through an entry-point group."""

from __future__ import annotations

from collections import UserDict
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from ffsm_mj.controller_protocol import StrictModel


class Classes(UserDict[str, Any]):
    """Classes by kind. In place of one may stand where it is: it is imported when it is asked for, most are in no run."""

    def __getitem__(self, kind: str) -> Any:
        """Class of a kind."""
        entry = super().__getitem__(kind)
        if isinstance(entry, EntryPoint):
            self[kind] = entry = entry.load()
        return entry


@dataclass(frozen=True)
class Kinds:
    """What a scenario may ask for.

    Attributes:
        configs: Configuration model by kind.
        classes: Class by kind; each has this model as its ``Config``.
        broken: Why a plugin could not be used, by kind.
    """

    configs: dict[str, type[StrictModel]]
    classes: Classes
    broken: dict[str, str]


def installed(group: str, built_in: Iterable[tuple[type[StrictModel], str]], noun: str) -> Kinds:
    """Built-in classes and those of installed plugins; a broken plugin harms only the scenarios that ask for it.

    Args:
        group: Entry-point group.
        built_in: Configuration models of this package, and ``module:Class`` of the class that each is for.
        noun: What they are, for messages.
    """
    kinds = Kinds({}, Classes(), {})
    for config, place in built_in:
        kind = _kind_of(config)
        kinds.configs[kind] = config
        kinds.classes[kind] = EntryPoint(kind, f"{__package__}.{place}", group)
    shipped = set(kinds.configs)
    for entry_point in entry_points(group=group):
        if entry_point.name in shipped:
            kinds.broken[entry_point.name] = f"{entry_point.value} has the name of a built-in {noun}; rename it"
            continue
        try:
            cls = _load(entry_point)
            kinds.configs[entry_point.name], kinds.classes[entry_point.name] = cls.Config, cls
        except Exception as error:  # noqa: BLE001 (a plugin may fail in any way)
            kinds.broken[entry_point.name] = f"{type(error).__name__}: {error}"
    return kinds


def _load(entry_point: EntryPoint) -> Any:
    cls = entry_point.load()
    config = getattr(cls, "Config", None)
    if not (isinstance(config, type) and issubclass(config, StrictModel)):
        raise TypeError(
            f"{entry_point.value} has no class attribute Config derived from ffsm_mj.controller_protocol.StrictModel"
        )
    config.model_rebuild()  # otherwise built with all others at the first use: a fault of it would harm every scenario
    if _kind_of(config) != entry_point.name:
        raise TypeError(f"{entry_point.value}: the entry point's name must be the kind {_kind_of(config)!r}")
    return cls


def _kind_of(config: type[StrictModel]) -> str:
    """The one value of the field ``kind``."""
    annotation: Any = config.model_fields["kind"].annotation
    return str(annotation.__args__[0])
