"""Checks that a finished run passes or fails: balances, impacts, overlap, contact forces."""
