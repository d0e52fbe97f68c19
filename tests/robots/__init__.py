"""Published robots from PyPI, whole: asked for by ``uv run --group robots pytest -m robots``."""
