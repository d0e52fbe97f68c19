"""Proofs of contact that lasts: closed forms, other integrators, other libraries, random scenes, wrong code put in."""
