"""Standard JSON: numbers that are not finite become null."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(data: Any) -> str:
    """Indented JSON text of plain data."""
    return json.dumps(_finite(data), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
