"""What a run leaves: signals and rows, events, the header. Knows the model only."""
