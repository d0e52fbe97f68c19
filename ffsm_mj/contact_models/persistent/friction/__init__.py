"""Coulomb friction in persistent contact: rows, modes, stage problem, decision and margins."""
