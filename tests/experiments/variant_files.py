"""Campaign files with variants for tests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.scenes import two_balls

FASTER = {"overrides": {"initial.rates.robot/x": 2.0}}
HALF = {"overrides": {"contacts.rules.0.restitution": 0.5}}


def variants_file(folder: Path, variants: dict[str, Any], **more: Any) -> Path:
    """Path of a campaign with variants of two balls, beside its scenario. Eight runs of 0.4 s, impulse 1.2 (1 + e) v."""
    folder.mkdir(exist_ok=True)
    two_balls(folder, restitution=1.0, duration_s=0.4)
    data = {
        "campaign": "try",
        "scenario": "scene.yaml",
        "samples": {"kind": "random", "n": 8, "seed": 1},
        "dispersions": {"initial.rates.robot/x": {"uniform": [0.9, 1.1]}},
        "variants": variants,
        "metrics": ["impacts.0.impulse_N_s"],
    }
    path = folder / "campaign.yaml"
    path.write_text(json.dumps(data | more, indent=1))
    return path
