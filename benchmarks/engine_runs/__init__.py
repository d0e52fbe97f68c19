"""Scenes, references and engine adapters of ``benchmarks/engines.py``."""
