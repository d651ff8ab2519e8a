"""The page in Debian's chromium, which a test never downloads, before a service of its own."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from tests.app.page.page import Page
from tests.app.service.server_process import Server, running
from tests.problems.eventually import PATIENCE

FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars"),
    *("--disable-background-networking", "--disable-component-update", "--no-first-run"),
    "--window-size=1440,900",
)


@pytest.fixture(scope="session")
def page_server() -> Iterator[Server]:
    with running() as server:
        yield server


@pytest.fixture(scope="session")
def browser() -> Iterator[webdriver.Chrome]:
    """One browser for all tests of a process.

    .ci/run sets BROWSER_TESTS in the environment: "required" makes a missing browser an error, "skipped" says that the
    browser does not start here.
    """
    if os.environ.get("BROWSER_TESTS") == "skipped":
        pytest.skip("chromium does not start here")
    binary, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if binary is None or driver is None:
        why = "chromium and chromedriver are not on PATH: apt-get install chromium chromium-driver"
        if os.environ.get("BROWSER_TESTS") == "required":
            pytest.fail(why)
        pytest.skip(why)
    options = webdriver.ChromeOptions()
    options.binary_location = binary
    for flag in FLAGS:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    found = webdriver.Chrome(options, Service(driver))
    found.set_script_timeout(PATIENCE)
    try:
        yield found
    finally:
        found.quit()


@pytest.fixture
def page(browser: webdriver.Chrome, page_server: Server) -> Iterator[Page]:
    """The page, empty as yet; no test may leave an error in the console or a request to anywhere else."""
    page = Page(browser, page_server.port)
    page.set_view(1440)
    yield page
    page.check_logs()


@pytest.fixture(scope="session")
def axe() -> str:
    return (Path(__file__).parent / "axe" / "axe.min.js").read_text(encoding="utf-8")
