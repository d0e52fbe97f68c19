"""``run.mcap``: its bytes, written and read."""
