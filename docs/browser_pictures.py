"""The pictures of pages in a browser: `make browser-pictures` (Chromium, ChromeDriver, npm)."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

import ffsm_mj
from ffsm_mj.report.page import write_page
from tests.browser.chromium import started

HERE = Path(__file__).parent
READER = HERE.parent / "tests/browser/reader/reader.html"


def main() -> None:
    """Run, write and look."""
    chromium, driver = (shutil.which(name) for name in ("chromium", "chromedriver"))
    if chromium is None or driver is None:
        raise SystemExit("no Chromium here: apt-get install chromium chromium-driver")
    with tempfile.TemporaryDirectory() as folder:
        run = ffsm_mj.run("baseline", out=Path(folder) / "run", rerun=False)
        write_page(run, Path(folder) / "run.html")
        with started(chromium, driver, Path(folder) / "profile", 1280, 1000) as browser:
            browser.open(Path(folder) / "run.html")
            keep("page", browser.window())
            browser.open(READER)
            browser.read(run.path)
            browser.run("return draw(arguments[0])", run.impacts[0].time_s + 1e-6)
            keep("foxglove-reader", browser.picture())


def keep(name: str, seen: Any) -> None:
    """Write what is seen."""
    picture = Image.fromarray(seen.astype("uint8")).quantize(256, Image.Quantize.FASTOCTREE)
    picture.save(HERE / "images" / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
