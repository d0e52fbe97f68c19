"""A headless Chromium that opens pages which the project writes; also for the pictures of the documentation."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image
from selenium import webdriver
from selenium.webdriver.common.by import By

ARGUMENTS = [
    *("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
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
        self.counts: dict = {}
        noted = "addEventListener('load', () => { window.atLoad = document.getElementById('message')?.textContent; });"
        driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": noted})

    def open(self, path, *, dark: bool = False) -> None:
        """Show a file; returns when its scene is drawn."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        for log in ("browser", "performance"):
            self._driver.get_log(log)
        self._driver.get(path.as_uri())
        self._until_shown(None)

    @contextmanager
    def narrowed(self, width: int) -> Iterator[None]:
        """A window as narrow as that of a phone, in pixels."""
        size = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": True}
        self._driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        try:
            yield
        finally:
            self._driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})

    def read(self, path):
        """Give a file to the page; returns what the page tells of it."""
        self.run("delete document.documentElement.dataset.shown")
        self.part("file").send_keys(str(path))
        self._until_shown(None)
        assert self.part("message").text == ""
        return self.run("return told")

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

    def window(self):
        """All that is in the window, (height, width, 3)."""
        with Image.open(io.BytesIO(self._driver.get_screenshot_as_png())) as image:
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
        raise AssertionError(f"nothing is drawn: {self.part('message').text!r}, {self.faults()}")


@contextmanager
def started(chromium: str, driver: str, profile: Path, *size: int) -> Iterator[Browser]:
    """A browser while it is needed, with an empty folder for what it keeps."""
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    for argument in (*ARGUMENTS, f"--user-data-dir={profile}", f"--window-size={','.join(map(str, size))}"):
        options.add_argument(argument)
    made = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        yield Browser(made)
    finally:
        made.quit()
