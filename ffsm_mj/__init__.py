"""ffsm-mj: exact impacts for free-floating space manipulators, on MuJoCo.

Four nouns: a ``Scenario``, built in Python or read from a file, is what is simulated; a ``Simulator`` steps it in a loop of
the caller's own; a ``Run`` is what came out; a ``Campaign`` repeats a scenario, or variants of it, with dispersed values.
``run(scenario)`` simulates, ``resume(run, from_s)`` goes on from an instant of a logged run, ``load_run(path)`` reads a run
back from its log, ``compare(a, b)`` tells two of them apart; ``sweep`` runs a scenario many times into one table;
``impact_map`` maps one contact over the configurations of the arm; ``impact`` resolves single collisions on any MuJoCo
model.

Functions of a run: ``explain(run)`` evaluates all of its checks and says why they fail; ``summary``, ``effort``,
``base_rotation`` and ``angular_momentum`` compute with its models; ``plot`` draws figures, ``animate`` a film;
``sensitivity`` repeats it with its uncertain numbers displaced.

Everything is imported on first use, so that ``import ffsm_mj`` and ``ffsm --help`` cost nothing.
"""

from __future__ import annotations

import importlib
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
    from ffsm_mj.experiments.campaign import Campaign as Campaign
    from ffsm_mj.experiments.campaign import compare_campaigns as compare_campaigns
    from ffsm_mj.experiments.campaign import sweep as sweep
    from ffsm_mj.experiments.impact_map.impact_map import impact_map as impact_map
    from ffsm_mj.experiments.sensitivity import sensitivity as sensitivity
    from ffsm_mj.replay import explain as explain
    from ffsm_mj.report.animation import animate as animate
    from ffsm_mj.report.plots.notebook import plot as plot
    from ffsm_mj.scenario.models import Model as Model
    from ffsm_mj.scenario.models import Robot as Robot

_LAZY = {
    "Campaign": ("ffsm_mj.experiments.campaign", "Campaign"),
    "compare_campaigns": ("ffsm_mj.experiments.campaign", "compare_campaigns"),
    "sweep": ("ffsm_mj.experiments.campaign", "sweep"),
    "resume": ("ffsm_mj.assembly.prepare", "resume"),
    "Scenario": ("ffsm_mj.assembly.prepare", "Scenario"),
    "run": ("ffsm_mj.assembly.prepare", "run"),
    "Simulator": ("ffsm_mj.assembly.simulator", "Simulator"),
    "SimulatorState": ("ffsm_mj.assembly.simulator", "SimulatorState"),
    "angular_momentum": ("ffsm_mj.analysis.run_models", "angular_momentum"),
    "animate": ("ffsm_mj.report.animation", "animate"),
    "base_rotation": ("ffsm_mj.analysis.run_models", "base_rotation"),
    "compare": ("ffsm_mj.analysis.run", "compare"),
    "effort": ("ffsm_mj.analysis.run_models", "effort"),
    "explain": ("ffsm_mj.replay", "explain"),
    "load_run": ("ffsm_mj.analysis.run", "load_run"),
    "plot": ("ffsm_mj.report.plots.notebook", "plot"),
    "sensitivity": ("ffsm_mj.experiments.sensitivity", "sensitivity"),
    "summary": ("ffsm_mj.analysis.run_models", "summary"),
    "Run": ("ffsm_mj.analysis.run", "Run"),
    "Robot": ("ffsm_mj.scenario.models", "Robot"),
    "Model": ("ffsm_mj.scenario.models", "Model"),
    "impact": ("ffsm_mj.impact", None),
    "impact_map": ("ffsm_mj.experiments.impact_map.impact_map", "impact_map"),
}

__all__ = [
    "Campaign",
    "Model",
    "Robot",
    "Run",
    "Scenario",
    "Simulator",
    "SimulatorState",
    "angular_momentum",
    "animate",
    "base_rotation",
    "compare",
    "compare_campaigns",
    "effort",
    "explain",
    "impact",
    "impact_map",
    "load_run",
    "plot",
    "resume",
    "run",
    "sensitivity",
    "summary",
    "sweep",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562)."""
    if name not in _LAZY:
        raise AttributeError(f"module 'ffsm_mj' has no attribute {name!r}; it has {', '.join(__all__)}")
    module_name, attribute = _LAZY[name]
    module = importlib.import_module(module_name)
    value = module if attribute is None else getattr(module, attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, imported or not, for ``dir`` and for completion."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
