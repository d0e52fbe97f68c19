"""The arithmetic of the ledgers; run and ``analyze`` call the same functions."""
