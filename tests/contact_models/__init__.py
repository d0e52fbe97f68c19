"""Contact models that exist in tests only."""
