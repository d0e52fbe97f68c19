"""Estimators. ``estimators()`` maps the ``kind`` of a scenario to its configuration model and class.

Estimators of other packages plug in through the entry-point group ``ffsm_mj.estimators``, as control laws do through
``ffsm_mj.controllers``; see :class:`~ffsm_mj.controller_protocol.Estimator`.
"""

from __future__ import annotations

from functools import cache

from ffsm_controllers.plugins import Kinds, installed

GROUP = "ffsm_mj.estimators"
_BUILT_IN = {
    "direct": ("estimators.direct:DirectConfig", "estimators.direct:Direct"),
    "mekf": ("estimators.mekf.config:MekfConfig", "estimators.mekf.estimator:Mekf"),
}


@cache
def estimators() -> Kinds:
    """Built-in estimators and those of installed plugins, looked up once."""
    return installed(GROUP, _BUILT_IN, "estimator")
