"""The pictures of the recordings in ``docs/images``, from the scenarios as they are: ``make screenshots``.

No display is needed: the viewer draws off screen (software Vulkan, Debian's ``mesa-vulkan-drivers``, is enough).
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path

from PIL import Image
from rerun.experimental import ViewerClient

import ffsm_mj
from ffsm_mj.cli.main import main as main_of_ffsm
from ffsm_mj.log.rerun.layout import TIMELINE
from ffsm_mj.log.rerun.viewer import viewer_command

IMAGES = Path(__file__).parent / "images"
SIZE = "1600x1000"
# Above the views is the viewer's own menu.
MENU_HEIGHT = 36
COLOURS = 256
# Picture, scenario, simulation time in s.
SHOTS = (
    ("approach", "baseline", 4.0),
    ("impact", "baseline", 7.9),
    ("recovery", "baseline", 18.8),
    ("spatial", "spatial", 2.95),
    ("thrusters", "free-flying-hardware", 7.9),
    ("orbit", "capture-orbit", 500.0),
    ("nozzle-capture", "nozzle-capture", 9.5),
    ("handrail", "handrail", 2.5),
)
START = "capture"
"""Scenario whose start is shown."""


def main() -> None:
    """Run each scenario once, open its recording and take its pictures."""
    IMAGES.mkdir(exist_ok=True)
    port = free_port()
    command = viewer_command("--headless", "--window-size", SIZE, "--port", str(port))
    with tempfile.TemporaryDirectory() as folder:
        viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        try:
            client = connected(port)
            for scenario in dict.fromkeys(scenario for _, scenario, _ in SHOTS):
                ffsm_mj.run(scenario, out=Path(folder) / scenario)
                client.open([str(Path(folder) / scenario / "run.rrd")])
                time.sleep(8.0)  # a recording of ten minutes takes some seconds to load
                for name, _, time_s in (shot for shot in SHOTS if shot[1] == scenario):
                    client.set_time(TIMELINE, duration=time_s, play_state="paused")
                    take(client, Path(folder) / f"{name}.png")
            main_of_ffsm(["view", START, "--save", f"{folder}/start.rrd"])
            client.open([f"{folder}/start.rrd"])
            take(client, Path(folder) / "start.png")
        finally:
            os.killpg(viewer.pid, signal.SIGTERM)  # the viewer is a child of the command that starts it
            viewer.wait()


def take(client: ViewerClient, path: Path) -> None:
    """Save what the viewer shows, without its menu and with a palette."""
    time.sleep(2.0)  # plots and trails arrive some frames after the cursor
    client.save_screenshot(str(path))
    with Image.open(path) as image:
        views = image.convert("RGB").crop((0, MENU_HEIGHT, image.width, image.height))
    small = IMAGES / path.name
    views.quantize(COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(small, optimize=True)
    print(f"{small.name}: {small.stat().st_size / 1e3:.0f} kB")


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def connected(port: int, patience_s: float = 30.0) -> ViewerClient:
    """The viewer, once it listens."""
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
            return ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        except OSError:
            time.sleep(0.1)
    raise TimeoutError(f"the viewer does not listen on port {port}; is a Vulkan driver installed?")


if __name__ == "__main__":
    main()
