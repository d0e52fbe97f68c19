"""Packages to start from: files of their own that run and pass their tests as they stand."""
