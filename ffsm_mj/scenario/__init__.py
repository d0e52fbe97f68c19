"""Scenarios: loading and validation of YAML files, JSON Schema, shipped scenarios."""
