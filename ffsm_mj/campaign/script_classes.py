"""Classes and functions that a script passes to a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ffsm_mj.assembly.prepare import Scenario


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


def own_classes(scenario: object, controllers: Mapping[str, Any], estimators: Mapping[str, Any]) -> ScriptClasses:
    """Control laws and estimators of a caller, with those of a scenario that he built, or states by its keys."""
    of_scenario = vars(scenario) if isinstance(scenario, Scenario) else scenario if isinstance(scenario, Mapping) else {}
    return ScriptClasses(
        {**of_scenario.get("controllers", {}), **controllers}, {**of_scenario.get("estimators", {}), **estimators}
    )
