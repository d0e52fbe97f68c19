"""From a scenario to a finished run: assemble, prepare, run."""
