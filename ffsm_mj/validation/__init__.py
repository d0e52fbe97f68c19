"""Validation: published numbers and closed forms beside those of the engine, by ``ffsm validate``."""
