"""Functional mock-up units under masters that others wrote."""
