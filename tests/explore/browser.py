"""Headless Chromium on the design page, and the command that serves it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement

PATIENCE_S = 120.0
CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--force-prefers-reduced-motion",
)


@contextmanager
def served(*arguments: str, **variables: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run textile-twin explore with environment `variables`, and yield the process and the address that it prints."""
    command = [str(Path(sys.executable).with_name("textile-twin")), "explore", *arguments, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | variables) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.terminate()
            process.wait(120)


class Moved(NamedTuple):
    """Times [ms] by the page's clock: from the slider event to the painted frame, share of the server, drawing."""

    painted_ms: float
    server_ms: float
    drawn_ms: float


# A task posted from the frame that shows a change runs after that frame is painted.
_MOVE = """
const [id, value, done] = arguments, slider = document.getElementById(id), body = document.body;
const before = body.dataset.states, channel = new MessageChannel();
let begun;
channel.port1.onmessage = () =>
  done({ painted_ms: performance.now() - begun, server_ms: +body.dataset.took, drawn_ms: +body.dataset.drawn });
new MutationObserver((_, watch) => {
  if (body.dataset.states === before) return;
  watch.disconnect();
  channel.port2.postMessage(0);
}).observe(body, { attributes: true });
slider.value = value;
begun = performance.now();
slider.dispatchEvent(new Event("input", { bubbles: true }));
"""


class Page:
    """Page in a browser, operated as a person would."""

    def __init__(self, size: str = "1500,1400", downloads: Path | None = None) -> None:
        self._profile = tempfile.TemporaryDirectory(prefix="chromium-")
        options = webdriver.ChromeOptions()
        for flag in (*FLAGS, f"--user-data-dir={self._profile.name}", f"--window-size={size}"):
            options.add_argument(flag)
        options.binary_location = CHROMIUM or ""
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        if downloads is not None:
            options.add_experimental_option("prefs", {"download.default_directory": str(downloads)})
        self.driver = webdriver.Chrome(options=options, service=Service(DRIVER))
        self.driver.set_script_timeout(PATIENCE_S)

    def close(self) -> None:
        self.driver.quit()
        self._profile.cleanup()

    def open(self, address: str) -> None:
        self.driver.get(address)
        self.until(lambda: self.states > 0)

    def as_phone(self, width: int, height: int) -> None:
        """Resize to a phone, which is narrower than a window can be."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)

    def as_window(self) -> None:
        """Restore the size of the window."""
        self.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})

    @property
    def states(self) -> int:
        """Number of answers shown."""
        return int(self.driver.find_element(By.TAG_NAME, "body").get_attribute("data-states") or 0)

    def moved(self, slider: str, value: float) -> Moved:
        """Set a slider to a value, as a drag does, and wait until the result is painted."""
        return Moved(**self.driver.execute_async_script(_MOVE, slider, value))

    def find(self, selector: str) -> WebElement:
        return self.driver.find_element(By.CSS_SELECTOR, selector)

    def text(self, selector: str) -> str:
        return self.find(selector).text

    def until(self, holds: Callable[[], object], seconds: float = PATIENCE_S) -> None:
        end = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < end, "the page did not come to what was waited for"
            time.sleep(0.03)

    def answered(self, act: Callable[[], object], seconds: float = PATIENCE_S) -> None:
        """Act, and wait for the page to show an answer."""
        before = self.states
        act()
        self.until(lambda: self.states > before, seconds)

    def number(self, name: str) -> float:
        return float(self.text(f"[data-number='{name}'] .value"))

    def curve(self, title: str) -> str:
        return self.find(f"[data-curve^='{title}/']").get_attribute("d") or ""

    def type(self, identity: str, text: str) -> None:
        """Type into a number field and leave it."""
        field = self.find(f"[id='{identity}']")
        field.clear()
        field.send_keys(text + "\t")

    def tick(self, parameter: str) -> None:
        box = self.find(f"[id='p_{parameter}']").find_element(By.XPATH, "..")
        box.find_element(By.CSS_SELECTOR, "input[type=checkbox]").click()

    @property
    def complaints(self) -> list[str]:
        """Return the errors in the browser's console."""
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]
