"""Dry friction of joints: what sticks, what slides, and when either ends."""
