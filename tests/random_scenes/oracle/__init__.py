"""An independent account of a log: what its states, impulses and columns must satisfy by numpy and scipy alone.

It reads the text of the models and the columns and records of the log; it shares no code with the engine.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.random_scenes.oracle.impacts import impact_differences
from tests.random_scenes.oracle.rows import row_differences
from tests.random_scenes.oracle.scene import LoggedScene


def oracle_differences(folder: Path, run: Any) -> list[str]:
    """What is wrong with a log."""
    scene = LoggedScene(folder, run)
    return [f"oracle: {text}" for text in (*row_differences(scene), *impact_differences(scene))]
