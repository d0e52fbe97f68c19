"""Contact regimes that exist in tests only."""
