"""ffsm-mj: exact impacts for free-floating space manipulators, on MuJoCo.

``run(scenario)`` simulates and returns a :class:`~ffsm_mj.analysis.Run`; ``load_run(path)`` reads one back from its log;
``impact`` resolves single collisions on any MuJoCo model. Everything is imported on first use, so that ``import ffsm_mj``
and ``ffsm --help`` cost nothing.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

# The matrices here are tiny: a second BLAS thread only spins. It must be said before numpy is first imported.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

if TYPE_CHECKING:
    from ffsm_mj import impact as impact
    from ffsm_mj.analysis import Run as Run
    from ffsm_mj.analysis import load_run as load_run
    from ffsm_mj.runner import run as run

_LAZY = {
    "run": ("ffsm_mj.runner", "run"),
    "load_run": ("ffsm_mj.analysis", "load_run"),
    "Run": ("ffsm_mj.analysis", "Run"),
    "impact": ("ffsm_mj.impact", None),
}

__all__ = ["Run", "impact", "load_run", "run"]


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562)."""
    if name not in _LAZY:
        raise AttributeError(f"module 'ffsm_mj' has no attribute {name!r}; it has {', '.join(__all__)}")
    module_name, attribute = _LAZY[name]
    module = importlib.import_module(module_name)
    value = module if attribute is None else getattr(module, attribute)
    globals()[name] = value
    return value
