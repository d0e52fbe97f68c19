"""A headless Chromium, for pages that the project writes; without one these tests say so and are skipped."""

from __future__ import annotations

import io
import json
import shutil
import time

import numpy as np
import pytest
from PIL import Image
from selenium import webdriver
from selenium.webdriver.common.by import By

ARGUMENTS = [
    *("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=800,700"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic"),
    "--host-resolver-rules=MAP * ~NOTFOUND",  # what asks the network is refused, and seen in the log
]
PATIENCE_S = 90.0
"""How long drawing by software may take on a machine that does much else."""


class Browser:
    """Opens pages and tells what became of them."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        """Take a driver that logs all."""
        self._driver = driver

    def open(self, path, *, dark: bool = False) -> None:
        """Show a file; returns when its scene is drawn."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        for log in ("browser", "performance"):
            self._driver.get_log(log)
        self._driver.get(path.as_uri())
        self._until_shown(None)

    def run(self, script: str, *arguments):
        """What a script in the page returns."""
        return self._driver.execute_script(script, *arguments)

    def slide(self, seconds: float) -> None:
        """Move the slider as a person does; returns when that time is drawn."""
        self.run("delete document.documentElement.dataset.shown")
        self.run(
            "arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('input'))", self.part("time"), seconds
        )
        self._until_shown(seconds)

    def click(self, name: str) -> None:
        """Click on a part."""
        self.part(name).click()

    def part(self, name: str):
        """An element by its id."""
        return self._driver.find_element(By.ID, name)

    def picture(self, name: str = "scene"):
        """A part as it is drawn, (height, width, 3)."""
        with Image.open(io.BytesIO(self.part(name).screenshot_as_png)) as image:
            return np.asarray(image.convert("RGB")).astype(int)

    @property
    def shown_s(self) -> float:
        """Time whose poses are drawn, s."""
        return float(self.run("return document.documentElement.dataset.shown"))

    def faults(self) -> list[str]:
        """What the console complained of since the page was opened."""
        return [entry["message"] for entry in self._driver.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]

    def requests(self) -> list[str]:
        """What was asked for since the page was opened, besides what the page has in itself."""
        messages = [json.loads(entry["message"])["message"] for entry in self._driver.get_log("performance")]
        asked = [each["params"]["request"]["url"] for each in messages if each["method"] == "Network.requestWillBeSent"]
        return [address for address in asked if not address.startswith(("data:", "blob:", "chrome"))]

    def _until_shown(self, seconds: float | None) -> None:
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            shown = self.run("return document.documentElement.dataset.shown")
            if shown is not None and (seconds is None or abs(float(shown) - seconds) < 1e-6):
                return
            time.sleep(0.02)
        pytest.fail(f"nothing is drawn: {self.part('message').text!r}, {self.faults()}")


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """One browser for all tests of a worker."""
    chromium, driver = (shutil.which(name) for name in ("chromium", "chromedriver"))
    if chromium is None or driver is None:
        pytest.skip("NO CHROMIUM HERE, PAGES ARE NOT TESTED: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    for argument in (*ARGUMENTS, f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"):
        options.add_argument(argument)
    started = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield Browser(started)
    started.quit()
