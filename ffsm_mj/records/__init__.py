"""Data of a run: signals and rows, event records, the header. Depends on the model only."""
