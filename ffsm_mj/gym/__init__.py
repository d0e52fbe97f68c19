"""Scenarios as Gymnasium environments: an exact plant to evaluate and to fine-tune on (docs/gymnasium.md).

``import ffsm_mj.gym`` registers the shipped environments ``ffsm_mj/Touch-v0``, ``ffsm_mj/CapturePlanar-v0`` and
``ffsm_mj/Capture-v0``; :func:`make` makes one of any scenario.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ffsm_mj.errors import MissingPackageError

try:
    import gymnasium
except ImportError as error:
    raise MissingPackageError("ffsm_mj.gym", "gymnasium", "gym") from error

from ffsm_mj.assembly.prepare import Scenario
from ffsm_mj.gym.env import ScenarioEnv
from ffsm_mj.gym.rendering import RenderError
from ffsm_mj.gym.rewards import EnvError, Transition
from ffsm_mj.scenario.shipped import scenarios_dir

__all__ = ["EnvError", "RenderError", "ScenarioEnv", "Transition", "make"]

_ENTRY_POINT = "ffsm_mj.gym.env:ScenarioEnv"
_SCENARIO = "ffsm_mj/Scenario-v0"


def make(
    scenario: Scenario | Mapping[str, Any] | str | Path, env: Mapping[str, Any] | None = None, **settings: Any
) -> gymnasium.Env[Any, Any]:
    """An environment of any scenario, in the wrappers of ``gymnasium.make``.

    Args:
        scenario: See :func:`ffsm_mj.run`.
        env: Keys of the section ``env`` that replace those of the file; see :class:`ScenarioEnv`.
        **settings: Further arguments of :class:`ScenarioEnv`, and of ``gymnasium.make``, such as ``render_mode``.
    """
    return gymnasium.make(_SCENARIO, scenario=str(scenario) if isinstance(scenario, Path) else scenario, env=env, **settings)


_SHIPPED = {"Touch": "touch", "CapturePlanar": "capture-planar", "Capture": "capture"}
"""Shipped environments by their files in ``scenarios/gym/``."""

gymnasium.register(_SCENARIO, entry_point=_ENTRY_POINT)
for _name, _file in _SHIPPED.items():
    gymnasium.register(
        f"ffsm_mj/{_name}-v0",
        entry_point=_ENTRY_POINT,
        kwargs={"scenario": str(scenarios_dir() / "gym" / f"{_file}.yaml")},
    )
