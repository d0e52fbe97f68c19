"""The arithmetic of the balances; run and ``analyze`` call the same functions."""
