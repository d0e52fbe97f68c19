"""Multiplicative error-state Kalman filter of the floating bodies of a scene; see ``docs/sensing.md``."""

from ffsm_controllers.estimators.mekf.estimator import Mekf

__all__ = ["Mekf"]
