"""Pictures of the Rerun viewer for the documentation: ``make screenshots``.

Runs three scenarios, cuts their logs off at chosen times and lets the viewer draw each without a display: it takes Debian's
``xvfb`` and ``mesa-vulkan-drivers``, and no graphics card.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

import ffsm_mj
from ffsm_mj.recording import write_recording

IMAGES = Path(__file__).parent / "images"
SIZE = "1600x1000"
SHOTS = {
    "baseline": {"approach": 4.0, "impact": 7.9, "recovery": 18.8},
    "free-flying-hardware": {"thrusters": 7.95},
    "spatial": {"spatial": 3.0},
}


def main() -> None:
    """Make every picture."""
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for scenario, times in SHOTS.items():
            log = ffsm_mj.run(scenario).log
            for name, until_s in times.items():
                recording = Path(folder) / f"{name}.rrd"
                write_recording(log, recording, until_s=until_s)
                shoot(recording, IMAGES / f"{name}.png")
                print(f"{IMAGES / name}.png: {scenario} at {until_s:g} s")


def shoot(recording: Path, picture: Path) -> None:
    """Let the viewer draw a recording, and keep the picture small."""
    command = ["xvfb-run", "-a", "-s", f"-screen 0 {SIZE}x24", sys.executable, "-m", "rerun", str(recording)]
    command += ["--screenshot-to", str(picture), "--window-size", SIZE]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=120)
    image = Image.open(picture).convert("RGB")
    image = image.resize((1600, round(1600 * image.height / image.width)), Image.Resampling.LANCZOS)
    image.quantize(128, dither=Image.Dither.NONE).save(picture, optimize=True)


if __name__ == "__main__":
    main()
