"""Checks of other physics than the engine's, from the log alone: they see a wrong program, not only a wrong file.

A log replay runs the engine again, so that a mistake in it agrees with itself. The checks in this package are written anew
on MuJoCo's own functions, and import of this project only what reads logs and compiles models, and tolerances (a contract of
the import linter): a proof must not share the mistakes of its subject. Record fields are read as plain columns.
"""
