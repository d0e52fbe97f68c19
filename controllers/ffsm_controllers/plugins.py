"""Classes by kind: built-in ones, and those that other packages offer through an entry-point group."""

from __future__ import annotations

from collections import UserDict
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from ffsm_mj.controller_protocol import StrictModel


class Classes(UserDict[str, Any]):
    """Classes by kind. In place of one may stand where it is: it is imported when it is asked for, most are in no run.

    A law has its configuration model in a module apart where its own imports are many.
    """

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

    configs: Classes
    classes: Classes
    broken: dict[str, str]


def installed(group: str, built_in: Mapping[str, tuple[str, str]], noun: str) -> Kinds:
    """Built-in classes and those of installed plugins; a broken plugin harms only the scenarios that ask for it.

    Args:
        group: Entry-point group.
        built_in: ``module:Class`` in this package of the configuration model and of the class that it is for, by kind.
        noun: What they are, for messages.
    """
    kinds = Kinds(Classes(), Classes(), {})
    for kind, places in built_in.items():
        for classes, place in zip((kinds.configs, kinds.classes), places, strict=True):
            classes[kind] = EntryPoint(kind, f"{__package__}.{place}", group)
    for entry_point in entry_points(group=group):
        if entry_point.name in built_in:
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
