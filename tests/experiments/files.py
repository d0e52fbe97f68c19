"""Campaign files for tests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.scenes import ball, scene

TUMBLING = [9.0, 8.0, 7.0, 0.6, 0.0, 0.8, 0.0]


def campaign_file(folder: Path, dispersions: dict[str, Any], samples: dict[str, Any] | None = None, **more: Any) -> Path:
    """A campaign beside its scenario ``scene.yaml``; returns its path. Eight random runs unless told otherwise."""
    data = {
        "campaign": "try",
        "scenario": "scene.yaml",
        "samples": samples or {"kind": "random", "n": 8, "seed": 1},
        "dispersions": dispersions,
    }
    path = folder / "campaign.yaml"
    path.write_text(json.dumps(data | more, indent=1))
    return path


def two_rocks(folder: Path, **scenario: Any) -> Path:
    """A free robot, one rock that tumbles and one whose state is not stated; two impact pairs."""
    return scene(
        folder,
        ball("ball"),
        {"rock": ball("rock"), "stone": ball("stone")},
        **{
            "initial": {
                "joints": {"rock/free": TUMBLING, "stone/free": [5, 0, 0, 1, 0, 0, 0]},
                "rates": {"rock/free": [0.1, 0.0, 0.0, 0.0, 0.0, 0.2]},
            },
            "contacts": {
                "rules": [
                    {"between": ["ball", "rock/rock"], "restitution": 0.8},
                    {"between": ["ball", "stone/stone"], "name": "second"},
                ]
            },
            **scenario,
        },
    )


def rock_hits(folder: Path, **more: Any) -> Path:
    """Eight runs of 0.05 s: a ball of 1 kg at a dispersed speed hits one at rest, J = (1 + e) v / 2 with e = 0.5."""
    rates = {"robot/free": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    joints = {"stone/free": [0.22, 0, 0, 1, 0, 0, 0], "rock/free": TUMBLING}
    two_rocks(folder, initial={"joints": joints, "rates": rates}, duration_s=0.05)
    speed = {"initial.rates.robot/free.0": {"uniform": [0.8, 1.6]}}
    return campaign_file(folder, speed, overrides={"contacts.rules.second.restitution": 0.5}, **more)
