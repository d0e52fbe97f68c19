"""Plug-ins that a scenario declares by kind: those that are registered, and those of installed packages by entry point."""

from __future__ import annotations

from collections.abc import Callable, Collection
from importlib.metadata import entry_points
from typing import ClassVar, Generic, Protocol, TypeVar

from ffsm_mj.config import StrictModel
from ffsm_mj.errors import described, unknown_name


class Plugin(Protocol):
    """A class with a kind and a configuration, which has a field ``kind``."""

    kind: ClassVar[str]
    Config: ClassVar[type[StrictModel]]


C = TypeVar("C", bound=type[Plugin])


class Plugins(Generic[C]):
    """Plug-ins of one sort, by kind; a broken package harms only the scenarios that ask for its kind.

    Attributes:
        registered: Those that are registered, by kind.
    """

    def __init__(
        self,
        group: str,
        noun: str,
        check: Callable[[C], object],
        *,
        built_in: Collection[str] = (),
        then: Callable[[C], object] | None = None,
    ) -> None:
        """Begin without plug-ins.

        Args:
            group: Group of entry points: the name of a point is the kind, its object the class.
            noun: What a plug-in is, for messages.
            check: Called with each class as it is registered: raises ``ValueError`` if it is unfit.
            built_in: Kinds that no plug-in may have.
            then: Called with each class that has been registered.
        """
        self._group, self._noun, self._check, self._built_in, self._then = group, noun, check, built_in, then
        self.registered: dict[str, C] = {}
        self._broken: dict[str, str] = {}

    def register(self, plugin: C) -> C:
        """Register a plug-in by its kind; it replaces one of the same class name, as a notebook defines it again.

        Raises:
            ValueError: Another one has the same kind, or it is unfit.
        """
        self._check(plugin)
        if plugin.kind in self._built_in:
            raise ValueError(f"{plugin.kind!r} is the kind of a built-in {self._noun}")
        other = self.registered.setdefault(plugin.kind, plugin)
        if (other.__module__, other.__qualname__) != (plugin.__module__, plugin.__qualname__):
            raise ValueError(f"another {self._noun} has the kind {plugin.kind!r}")
        self.registered[plugin.kind] = plugin
        if self._then is not None:
            self._then(plugin)
        return plugin

    def every(self) -> dict[str, C]:
        """Plug-ins that a scenario may declare, by kind: registered ones and those of installed packages."""
        for entry_point in entry_points(group=self._group):
            if entry_point.name in self._built_in:
                fault = f"{entry_point.value} has the name of a built-in {self._noun}; rename it"
                self._broken[entry_point.name] = fault
            elif entry_point.name not in self.registered:
                try:
                    plugin = entry_point.load()
                    plugin.Config.model_rebuild()  # now, while what is wrong with it is the package's alone
                    self.register(plugin)
                except Exception as error:  # noqa: BLE001 (a package may fail in any way: only its plug-in is unavailable)
                    self._broken[entry_point.name] = described(error)
        return dict(self.registered)

    def named(self, kind: str) -> C:
        """Look up a plug-in by kind.

        Raises:
            LookupError: There is none; the message lists the known kinds.
        """
        if registered := self.registered.get(kind):
            return registered  # without the search for packages, which reads metadata of every package there is
        known = self.every()
        if kind in self._broken:
            reason = self._broken[kind]
            raise LookupError(f"the {self._noun} {kind!r} of an installed package cannot be used ({reason})")
        if not known:
            raise LookupError(f"unknown {self._noun} {kind!r}: no installed package provides one")
        if kind not in known:
            raise LookupError(unknown_name(self._noun, kind, known))
        return known[kind]
