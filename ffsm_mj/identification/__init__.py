"""Identification: impacts that were measured, what their frames say of themselves, and the laws that fit them."""
