"""The loop, and the rows that it fills. Knows no control law and no scenario."""
