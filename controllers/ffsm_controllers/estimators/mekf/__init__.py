"""Multiplicative error-state Kalman filter of the floating bodies of a scene; see ``docs/state-estimation.md``."""

from ffsm_controllers.estimators.mekf.estimator import Mekf

__all__ = ["Mekf"]
