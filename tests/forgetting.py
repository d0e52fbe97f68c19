"""The likely mistake with states: a part that does not take back one field of what it remembers."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pkgutil import walk_packages
from typing import Any

from ffsm_mj.state import as_mappings


def classes_with_state(package: str) -> dict[str, type[Any]]:
    """All classes of a package with a state of their own by name, those of modules that are imported when needed too."""
    for module in walk_packages(import_module(package).__path__, f"{package}."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    return {
        kind.__name__: kind
        for name, module in sorted(sys.modules.items())
        if name.partition(".")[0] == package
        for kind in vars(module).values()
        if isinstance(kind, type) and kind.__module__ == name and "State" in vars(kind) and hasattr(kind, "set_state")
    }


@contextmanager
def forgetting(kind: type[Any], field: str) -> Iterator[None]:
    """Every part of a class keeps what it has in place of one field of a state that it is given."""
    own, original = "set_state" in vars(kind), kind.set_state

    def set_state(self: Any, state: Any, *others: Any) -> None:
        points = others if kind.__name__ == "FrictionModes" else ()
        present = as_mappings(self.get_state(*points))
        original(self, {**as_mappings(state), field: present[field]}, *others)

    kind.set_state = set_state
    try:
        yield
    finally:
        if own:
            kind.set_state = original
        else:
            del kind.set_state
