"""ffsm-mj: exact impacts for free-floating space manipulators, on MuJoCo.

Four nouns: a ``Scenario``, built in Python or read from a file, is what is simulated; a ``Simulator`` steps it in a loop of
the caller's own; a ``Run`` is what came out; a ``Campaign`` repeats a scenario with dispersed values. ``run(scenario)``
simulates, ``load_run(path)`` reads a run back from its log, ``compare(a, b)`` tells two of them apart; ``sweep`` runs a
scenario many times into one table; ``run_study`` compares variants over the same samples; ``impact_map`` maps one contact
over the configurations of the arm; ``impact`` resolves single collisions on any MuJoCo model. Everything is imported on
first use, so that ``import ffsm_mj`` and ``ffsm --help`` cost nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ffsm_mj import impact as impact
    from ffsm_mj.analysis.run import compare as compare
    from ffsm_mj.assembly.go_on import go_on as go_on
    from ffsm_mj.assembly.prepare import Scenario as Scenario
    from ffsm_mj.assembly.prepare import run as run
    from ffsm_mj.assembly.simulator import Simulator as Simulator
    from ffsm_mj.campaign.campaign import Campaign as Campaign
    from ffsm_mj.campaign.comparison import compare_campaigns as compare_campaigns
    from ffsm_mj.campaign.sweep import sweep as sweep
    from ffsm_mj.impact_maps.impact_map import impact_map as impact_map
    from ffsm_mj.report.run import Run as Run
    from ffsm_mj.report.run import load_run as load_run
    from ffsm_mj.scenario.model_config import Model as Model
    from ffsm_mj.scenario.model_config import Robot as Robot
    from ffsm_mj.studies.script import run_study as run_study
    from ffsm_mj.studies.study import Study as Study

_LAZY = {
    "Campaign": ("ffsm_mj.campaign.campaign", "Campaign"),
    "compare_campaigns": ("ffsm_mj.campaign.comparison", "compare_campaigns"),
    "sweep": ("ffsm_mj.campaign.sweep", "sweep"),
    "go_on": ("ffsm_mj.assembly.go_on", "go_on"),
    "Scenario": ("ffsm_mj.assembly.prepare", "Scenario"),
    "run": ("ffsm_mj.assembly.prepare", "run"),
    "Simulator": ("ffsm_mj.assembly.simulator", "Simulator"),
    "compare": ("ffsm_mj.analysis.run", "compare"),
    "load_run": ("ffsm_mj.report.run", "load_run"),
    "run_study": ("ffsm_mj.studies.script", "run_study"),
    "Study": ("ffsm_mj.studies.study", "Study"),
    "Run": ("ffsm_mj.report.run", "Run"),
    "Robot": ("ffsm_mj.scenario.model_config", "Robot"),
    "Model": ("ffsm_mj.scenario.model_config", "Model"),
    "impact": ("ffsm_mj.impact", None),
    "impact_map": ("ffsm_mj.impact_maps.impact_map", "impact_map"),
}

__all__ = [
    "Campaign",
    "Model",
    "Robot",
    "Run",
    "Scenario",
    "Simulator",
    "Study",
    "compare",
    "compare_campaigns",
    "go_on",
    "impact",
    "impact_map",
    "load_run",
    "run",
    "run_study",
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
