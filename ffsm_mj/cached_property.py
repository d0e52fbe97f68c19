"""``functools.cached_property`` without the lock of Python 3.11.

Taking the lock at every first access costs more than most operations on small arrays; Python 3.12 has dropped it.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or sys.version_info >= (3, 12):
    from functools import cached_property
else:

    class cached_property:  # noqa: N801 (the name that it replaces)
        """A method that is evaluated once per object, at its first access as an attribute."""

        def __init__(self, method: Any) -> None:
            """Store the method."""
            self._method, self.__doc__ = method, method.__doc__

        def __set_name__(self, _: type, name: str) -> None:
            """Take the name of the attribute."""
            self._name = name

        def __get__(self, instance: Any, _: type | None = None) -> Any:
            """Evaluate the method; its value hides this descriptor from now on."""
            if instance is None:
                return self
            value = instance.__dict__[self._name] = self._method(instance)
            return value


__all__ = ["cached_property"]
