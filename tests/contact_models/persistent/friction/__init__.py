"""Friction in persistent contact: closed forms, published digits, orders, frames, and wrong code."""
