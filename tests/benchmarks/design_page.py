"""Latency of the design page behind a slider, in a real headless Chromium: python -m tests.benchmarks.design_page

For each machine: milliseconds from the slider's event to the painted curves and numbers, by the page's own clock,
median and 95th percentile, with the server's share and the drawing's. Then the same while it is dragged steadily.
"""

from __future__ import annotations

import argparse
import itertools
import os
import statistics
import tempfile
import time
from pathlib import Path

from selenium.webdriver.common.by import By

from tests.explore.browser import Page, served

SLIDERS = {
    "tufting": "s_l1_m",
    "handloom_beatup": "s_crank_m",
    "needle_transfer": "s_stroke_m",
    "elliptic_gear_beatup": "s_crank_m",
}
# Every frame the slider moves on a little; when its answers are shown.
_DRAG = """
const [id, from, to, seconds, done] = arguments, slider = document.getElementById(id), begun = performance.now();
const shown = [], body = document.body;
let states = body.dataset.states;
new MutationObserver((_, watch) => {
  if (body.dataset.states === states) return;
  states = body.dataset.states;
  shown.push(performance.now());
  if (performance.now() - begun > 1000 * seconds) { watch.disconnect(); done(shown); }
}).observe(body, { attributes: true });
const step = () => {
  const share = (performance.now() - begun) / (1000 * seconds);
  if (share > 1.0) return;
  slider.value = from + (to - from) * Math.abs(((4 * share) % 2) - 1);
  slider.dispatchEvent(new Event("input", { bubbles: true }));
  requestAnimationFrame(step);
};
step();
"""


def main() -> None:
    """All four machines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moves", type=int, default=40, help="slider moves a machine")
    parser.add_argument("--cold", action="store_true", help="the first look at the needle transfer, nothing compiled")
    arguments = parser.parse_args()
    if arguments.cold:
        _cold()
        return
    moves = arguments.moves
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}")
    print(f"{'machine':22}{'painted':>9}{'95 %':>7}{'server':>8}{'of it':>7}{'drawing':>9}{'dragged':>9}")
    with served("tufting") as (server, address):
        page = Page()
        page.driver.set_script_timeout(60)
        try:
            page.open(address)
            for name, slider in SLIDERS.items():
                _choose(page, name)
                low, high = _near(page, slider)
                steps = [low + (high - low) * k / (moves - 1) for k in range(moves)]
                worked = _processor_s(server.pid)
                taken = [page.moved(slider, value) for value in steps]
                worked = _processor_s(server.pid) - worked
                painted = sorted(t.painted_ms for t in taken)
                shown = page.driver.execute_async_script(_DRAG, slider, low, high, 3.0)
                between = [b - a for a, b in itertools.pairwise(shown)]
                print(
                    f"{name:22}{statistics.median(painted):9.0f}{painted[int(0.95 * len(painted))]:7.0f}"
                    f"{statistics.median(t.server_ms for t in taken):8.0f}"
                    f"{1e3 * worked / moves:7.0f}"
                    f"{statistics.median(t.drawn_ms for t in taken):9.0f}{statistics.median(between):9.0f}",
                    flush=True,
                )
        finally:
            page.close()
    print("milliseconds; 'of it': the server's processor time; 'dragged': from one answer to the next, without rest")


def _cold() -> None:
    """Measure the page while the loops of the needle transfer are compiled."""
    with tempfile.TemporaryDirectory() as empty, served("tufting", TEXTILE_TWIN_CACHE_DIR=empty) as (_, address):
        page = Page()
        page.driver.set_script_timeout(60)
        try:
            page.open(address)
            begun = time.monotonic()
            page.answered(lambda: page.find("#machine option[value=needle_transfer]").click(), 60)
            print(f"answered after {time.monotonic() - begun:.1f} s", flush=True)
            page.until(lambda: "compiled" in page.text("#banner"))
            print(page.text("#banner"), flush=True)
            page.driver.switch_to.new_window("tab")
            page.open(address)
            low, high = _near(page, "s_l1_m")
            taken = [page.moved("s_l1_m", low + (high - low) * k / 19).painted_ms for k in range(20)]
            print(f"meanwhile, in another tab: a slider's answer in {statistics.median(taken):.0f} ms", flush=True)
            page.driver.close()
            page.driver.switch_to.window(page.driver.window_handles[0])
            page.until(lambda: page.driver.find_elements(By.CSS_SELECTOR, "[data-number=impacts]"), 900)
            print(f"shown after {time.monotonic() - begun:.1f} s", flush=True)
            low, high = _near(page, "s_stroke_m")
            taken = [page.moved("s_stroke_m", low + (high - low) * k / 19).painted_ms for k in range(20)]
            print(f"then a slider's answer in {statistics.median(taken):.0f} ms")
        finally:
            page.close()


def _choose(page: Page, name: str) -> None:
    if name.replace("_", " ") in page.driver.title:
        return
    begun = time.monotonic()
    page.find(f"#machine option[value={name}]").click()
    page.until(lambda: name.replace("_", " ") in page.driver.title, 600.0)
    print(f"{name}: first look after {time.monotonic() - begun:.1f} s", flush=True)


def _processor_s(process: int) -> float:
    """Processor time that a process has used so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _near(page: Page, slider: str) -> tuple[float, float]:
    """Values close to the design's, so that every one of them closes."""
    value = float(page.find(f"#{slider}").get_attribute("value") or "nan")
    return 0.98 * value, 1.0 * value


if __name__ == "__main__":
    main()
