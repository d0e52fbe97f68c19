"""ffsm-mj: exact impacts for free-floating space manipulators, on MuJoCo.

Four nouns: a ``Scenario``, built in Python or read from a file, is what is simulated; a ``Simulator`` steps it in a loop of
the caller's own; a ``Run`` is what came out; a ``Campaign`` repeats a scenario, or variants of it, with dispersed values.
``run(scenario)`` simulates, ``resume(run, from_s)`` goes on from an instant of a logged run, ``load_run(path)`` reads a run
back from its log, ``compare(a, b)`` tells two of them apart; ``sweep`` runs a scenario many times into one table;
``impact_map`` maps one contact over the configurations of the arm; ``impact`` resolves single collisions on any MuJoCo
model.

Functions of a run: ``explain(run)`` evaluates all of its checks and says why they fail; ``summary``, ``effort``,
``base_rotation`` and ``angular_momentum`` compute with its models; ``plot`` draws figures, ``animate`` a film;
``sensitivity`` repeats it with its uncertain numbers displaced. ``progress()`` is what a ``report`` of these may be.

Everything is imported on first use, so that ``import ffsm_mj`` and ``ffsm --help`` cost nothing.
"""

from __future__ import annotations

import importlib.metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ffsm_mj import impact as impact
    from ffsm_mj.analysis.run import Run as Run
    from ffsm_mj.analysis.run import compare as compare
    from ffsm_mj.analysis.run import load_run as load_run
    from ffsm_mj.analysis.run_models import angular_momentum as angular_momentum
    from ffsm_mj.analysis.run_models import base_rotation as base_rotation
    from ffsm_mj.analysis.run_models import effort as effort
    from ffsm_mj.analysis.run_models import summary as summary
    from ffsm_mj.assembly.prepare import Scenario as Scenario
    from ffsm_mj.assembly.prepare import resume as resume
    from ffsm_mj.assembly.prepare import run as run
    from ffsm_mj.assembly.simulator import Simulator as Simulator
    from ffsm_mj.assembly.simulator import SimulatorState as SimulatorState
    from ffsm_mj.errors import ScenarioNote as ScenarioNote
    from ffsm_mj.experiments.campaign import Campaign as Campaign
    from ffsm_mj.experiments.campaign import compare_campaigns as compare_campaigns
    from ffsm_mj.experiments.campaign import sweep as sweep
    from ffsm_mj.experiments.impact_map.impact_map import impact_map as impact_map
    from ffsm_mj.experiments.sensitivity import sensitivity as sensitivity
    from ffsm_mj.replay import explain as explain
    from ffsm_mj.report.animation import animate as animate
    from ffsm_mj.report.plots.notebook import plot as plot
    from ffsm_mj.report.progress import progress as progress
    from ffsm_mj.scenario.models import Model as Model
    from ffsm_mj.scenario.models import Robot as Robot

_NAMES = {
    "ffsm_mj.analysis.run": ("Run", "compare", "load_run"),
    "ffsm_mj.analysis.run_models": ("angular_momentum", "base_rotation", "effort", "summary"),
    "ffsm_mj.assembly.prepare": ("Scenario", "resume", "run"),
    "ffsm_mj.assembly.simulator": ("Simulator", "SimulatorState"),
    "ffsm_mj.errors": ("ScenarioNote",),
    "ffsm_mj.experiments.campaign": ("Campaign", "compare_campaigns", "sweep"),
    "ffsm_mj.experiments.impact_map.impact_map": ("impact_map",),
    "ffsm_mj.experiments.sensitivity": ("sensitivity",),
    "ffsm_mj.replay": ("explain",),
    "ffsm_mj.report.animation": ("animate",),
    "ffsm_mj.report.plots.notebook": ("plot",),
    "ffsm_mj.report.progress": ("progress",),
    "ffsm_mj.scenario.models": ("Model", "Robot"),
}
"""Public names by the modules that have them."""
_LAZY = {name: module for module, names in _NAMES.items() for name in names}

__all__ = sorted((*_LAZY, "impact"))  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562)."""
    if name == "__version__":
        return importlib.metadata.version("ffsm-mj")
    if name not in __all__:
        raise AttributeError(f"module 'ffsm_mj' has no attribute {name!r}; it has {', '.join(__all__)}")
    module = importlib.import_module(_LAZY.get(name, f"ffsm_mj.{name}"))
    value = getattr(module, name) if name in _LAZY else module
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, imported or not, for ``dir`` and for completion."""
    return sorted({*__all__, "__version__", *(name for name in globals() if name.startswith("__"))})
