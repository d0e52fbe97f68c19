"""A headless Chromium; without one the tests of pages say so and are skipped."""

from __future__ import annotations

import shutil

import pytest

from tests.browser.chromium import started


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """One browser for all tests of a worker."""
    chromium, driver = (shutil.which(name) for name in ("chromium", "chromedriver"))
    if chromium is None or driver is None:
        pytest.skip("NO CHROMIUM HERE, PAGES ARE NOT TESTED: apt-get install chromium chromium-driver")
    with started(chromium, driver, tmp_path_factory.mktemp("chromium"), 800, 700) as found:
        yield found
