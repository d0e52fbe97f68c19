"""Where the files of published robots lie: in packages of the dependency group ``robots``, of which nothing is imported."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest


def vendor_path(package: str, path: str) -> Path:
    """A file or folder of an installed package; the test fails where it is not there."""
    try:
        installed = distribution(package)
    except PackageNotFoundError:
        installed = None
    if installed is None:
        pytest.fail(f"{package} is not installed: uv run --group dev --group robots pytest -m robots", pytrace=False)
    found = Path(str(installed.locate_file(path)))
    if not found.exists():
        pytest.fail(f"{package} {installed.version} has no {path}", pytrace=False)
    return found
