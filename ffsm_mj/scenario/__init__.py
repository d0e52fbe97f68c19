"""The scenario: YAML in, validated and frozen; its schema; the shipped ones."""
