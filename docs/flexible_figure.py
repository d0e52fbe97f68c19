"""The figure of ``docs/joints.md``, from the scenario as it is: ``make figures``."""

from __future__ import annotations

from pathlib import Path

import ffsm_mj
from ffsm_mj.report.plots import save

FOLDER = Path(__file__).parent / "figures" / "capture-flexible"


def main() -> None:
    """Run the scenario, draw how the panel rings."""
    save(ffsm_mj.run("capture-flexible"), FOLDER, ("springs",), ("svg",))


if __name__ == "__main__":
    main()
