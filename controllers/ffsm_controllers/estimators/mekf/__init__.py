"""Multiplicative error-state Kalman filter of the floating bodies of a scene; see ``docs/state-estimation.md``."""
