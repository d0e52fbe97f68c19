"""Assembly of a run from a scenario: compile models, build the plant and contact models, run."""
