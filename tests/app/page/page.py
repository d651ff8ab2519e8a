"""The page as a test sees and uses it."""

import json
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import quote

from selenium.webdriver import Chrome, Keys
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement

from tests.problems.eventually import PATIENCE

PUT = {"option_type": "put", "spot": 100, "strike": 100, "expiry": 1, "rate": 0.05, "volatility": 0.2}
DIVIDENDS = [{"time": time, "amount": 1} for time in (0.2, 0.45, 0.7, 0.95)]
CHARTS = ("value", "multiplier", "boundary", "delta", "gamma", "theta", "vega")
# What a browser says of an answer with an error status: the page is told of it as well.
EXPECTED = ("the server responded with a status of", "net::ERR_CONNECTION", "net::ERR_EMPTY_RESPONSE")


class Page:
    """The page of one service in one browser."""

    def __init__(self, browser: Chrome, port: int) -> None:
        self.browser, self.address = browser, f"http://127.0.0.1:{port}/"
        browser.get("about:blank")
        browser.get_log("browser")
        browser.get_log("performance")

    def set_view(self, width: int, height: int = 900, scheme: str = "light") -> None:
        view = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", view)
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})

    def open(self, question: dict[str, Any] | None = None) -> None:
        """Load the page with a contract in its address, and wait for its charts."""
        self.browser.get("about:blank")
        self.browser.get(self.address + ("#" + fragment(question) if question else ""))
        self.settled()

    def settled(self, charts: str = "current") -> None:
        """Wait until the charts are in a state."""
        self.eventually(lambda: self.state() == charts, f"charts {charts}")

    def state(self) -> str:
        return str(self.script("return document.body.dataset.charts"))

    def eventually(self, holds: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + PATIENCE
        while not holds():
            if time.monotonic() > end:
                said = [entry["message"] for entry in self.browser.get_log("browser")]
                raise AssertionError(f"not seen in {PATIENCE} s: {what}; the console says {said}")
            time.sleep(0.03)

    def script(self, text: str, *arguments: object) -> Any:
        return self.browser.execute_script(text, *arguments)

    def at(self, selector: str) -> WebElement:
        return self.browser.find_element(By.CSS_SELECTOR, selector)

    def all(self, selector: str) -> list[WebElement]:
        return self.browser.find_elements(By.CSS_SELECTOR, selector)

    def type(self, name: str, text: str) -> None:
        """Put a text in the place of what is in a field, in one change."""
        self.script(
            "const field = document.getElementById(arguments[0]); field.value = arguments[1];"
            "field.dispatchEvent(new InputEvent('input', {bubbles: true}))",
            *(name, text),
        )

    def click(self, selector: str) -> None:
        """Click what stands in the middle of the screen: on a phone the price covers its top."""
        found = self.at(selector)
        self.script("arguments[0].scrollIntoView({block: 'center'})", found)
        found.click()

    def number(self, name: str) -> float | None:
        """Return a number of the table of results, unrounded."""
        text = self.at(f'#numbers [data-name="{name}"]').get_dom_attribute("value")
        return float(text) if text else None

    def price(self) -> float:
        return float(self.at("#price").get_dom_attribute("value") or "nan")

    def error_at(self, name: str) -> str:
        return self.at(f'[data-field="{name}"] > .error').text

    def press(self, *keys: str) -> None:
        for key in keys:
            self.browser.switch_to.active_element.send_keys(key)

    def focused(self) -> str:
        return str(self.script("return document.activeElement.id"))

    def tab_to(self, name: str) -> None:
        for _ in range(80):
            if self.focused() == name:
                return
            self.press(Keys.TAB)
        raise AssertionError(f"{name} cannot be reached by Tab")

    def check_logs(self) -> None:
        """Hold that nothing was wrong in the console and that every request went to the service itself."""
        said = [entry["message"] for entry in self.browser.get_log("browser")]
        wrong = [message for message in said if not any(part in message for part in EXPECTED)]
        assert not wrong, wrong
        for entry in self.browser.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                address = message["params"]["request"]["url"]
                assert address.startswith((self.address, "about:", "data:", "blob:")), address


def fragment(question: dict[str, Any]) -> str:
    texts = {name: value if isinstance(value, str) else json.dumps(value) for name, value in question.items()}
    return "&".join(f"{name}={quote(text)}" for name, text in texts.items())
