"""The figures of ``docs/capture.md``, from the scenario as it is: ``make figures``."""

from __future__ import annotations

from pathlib import Path

import ffsm_mj
from ffsm_mj.report.plots import save

FOLDER = Path(__file__).parent / "figures" / "capture-planar"


def main() -> None:
    """Run the scenario, draw where it goes and what the grip bears."""
    save(ffsm_mj.run("capture-planar"), FOLDER, ("motion", "grasps"), ("svg",))


if __name__ == "__main__":
    main()
