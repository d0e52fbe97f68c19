"""Classes and functions that a script passes to a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class ScriptClasses:
    """Control laws and estimators of a script, classes by kind, and its metrics; picklable if they are.

    Attributes:
        controllers: Control laws.
        estimators: Estimators.
        metrics: Functions of a :class:`~ffsm_mj.analysis.run.Run` by the name of the metric.
    """

    controllers: Mapping[str, Any] = field(default_factory=dict)
    estimators: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def every(self) -> dict[str, Any]:
        """All of them."""
        return {**self.controllers, **self.estimators, **self.metrics}


NO_CLASSES = ScriptClasses()
