"""A finished run for people: figures, text, exports, films."""
