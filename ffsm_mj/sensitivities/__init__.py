"""Sensitivity of the outcomes of a run to stated uncertainties of its scenario."""
