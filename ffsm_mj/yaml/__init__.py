"""YAML 1.2 with the place of every value; ruamel.yaml reads, what YAML itself lets pass is checked."""
