"""Endurance test of the page: two tabs, sliders, undo, other machines, lost connections, sleep, reloads.

    python -m tests.explore.soak --minutes 30 [--pause 60]

One round is about an hour of use, ten rounds a night. After each round the memory is printed: resident memory of the
server [MB], heap of the page after garbage collection [MB], elements of its document.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.explore.browser import Page, served
from tests.explore.wire import Wire, wire

MACHINES = {
    "tufting": "s_l1_m",
    "handloom_beatup": "s_crank_m",
    "elliptic_gear_beatup": "s_crank_m",
    "needle_transfer": "s_stroke_m",
}
# Moves a slider repeatedly, each time after the last answer is shown.
_MOVES = """
const [id, times, done] = arguments, slider = document.getElementById(id), middle = slider.valueAsNumber;
const body = document.body;
let left = times, states = body.dataset.states;
const move = () => {
  slider.value = middle * (1 - 0.01 * Math.abs(Math.sin(left)));
  slider.dispatchEvent(new Event("input", { bubbles: true }));
};
new MutationObserver((_, watch) => {
  if (body.dataset.states === states) return;
  states = body.dataset.states;
  left -= 1;
  if (left > 0) setTimeout(move, 0);
  else { watch.disconnect(); done(times); }
}).observe(body, { attributes: true });
move();
"""


class Memory(NamedTuple):
    """Memory after a round."""

    moves: int
    server_MB: float
    page_MB: float
    elements: int


class Soak:
    """Rounds on one server and one browser with two tabs."""

    def __init__(self, page: Page, server: int, link: Wire, address: str, names: tuple[str, ...]) -> None:
        self.page, self.server, self.link, self.names = page, server, link, names
        self.moves = 0
        page.open(address)
        self.tabs = [page.driver.current_window_handle]
        page.driver.switch_to.new_window("tab")
        page.open(address)
        self.tabs.append(page.driver.current_window_handle)

    def round(self, moves: int) -> Memory:
        """Run one round: both tabs, `moves` slider moves per machine, a lost connection, a sleep, a reload."""
        page = self.page
        for tab in self.tabs:
            page.driver.switch_to.window(tab)
            for name in self.names:
                if name.replace("_", " ") not in page.driver.title:
                    page.find(f"#machine option[value={name}]").click()
                    page.until(lambda name=name: name.replace("_", " ") in page.driver.title)
                page.answered(lambda: page.find("#pin").click())
                self.moves += page.driver.execute_async_script(_MOVES, MACHINES[name], moves)
                page.answered(lambda: page.find("#undo").click())
                page.answered(lambda: page.find("#pin").click())
        self._lose_the_wire()
        self._sleep()
        page.driver.refresh()
        page.until(lambda: page.states > 0)
        return self.memory()

    def _lose_the_wire(self) -> None:
        page = self.page
        stroke = page.text("#numbers tbody tr:nth-child(2)")
        self.link.cut()
        page.until(lambda: "trying again" in page.text("#banner"))
        before = page.states
        self.link.mend()
        page.until(lambda: page.states > before and not page.find("#banner").is_displayed())
        assert page.text("#numbers tbody tr:nth-child(2)") == stroke

    def _sleep(self) -> None:
        """Suspend the server, as when the lid of the computer is closed; the connection breaks."""
        page, before = self.page, self.page.states
        os.kill(self.server, signal.SIGSTOP)
        self.link.cut()
        time.sleep(1.0)
        self.link.mend()
        time.sleep(1.0)
        os.kill(self.server, signal.SIGCONT)
        page.until(lambda: page.states > before and not page.find("#banner").is_displayed())

    def pause(self, seconds: float) -> None:
        """Leave the page alone; the linkage keeps moving."""
        if seconds:
            self.page.find("#play").click()
            time.sleep(seconds)
            self.page.find("#play").click()

    def memory(self) -> Memory:
        """Measure the memory of server and visible tab."""
        driver = self.page.driver
        driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
        heap = driver.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"]
        elements = driver.execute_cdp_cmd("Memory.getDOMCounters", {})["nodes"]
        status = Path(f"/proc/{self.server}/status").read_text()
        resident = float(re.findall(r"VmRSS:\s+(\d+)", status)[0]) / 1024.0
        return Memory(self.moves, resident, heap / 2**20, elements)


def soak(
    minutes: float, moves: int, names: tuple[str, ...] = tuple(MACHINES), rounds: int = 10**9, pause_s: float = 0.0
) -> Iterator[Memory]:
    """Run rounds for a time, with a pause after each, and return the memory after each round."""
    with served("tufting") as (server, address):
        port = int(re.findall(r":(\d+)/", address)[0])
        with wire(port) as link:
            page = Page()
            try:
                run = Soak(page, server.pid, link, address.replace(str(port), str(link.port)), names)
                end = time.monotonic() + 60.0 * minutes
                while time.monotonic() < end and rounds > 0:
                    rounds -= 1
                    yield run.round(moves)
                    run.pause(pause_s)
                assert not [c for c in page.complaints if "WebSocket" not in c and "ERR_" not in c]
            finally:
                page.close()


def main() -> None:
    """Print the result of every round."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--moves", type=int, default=100, help="slider moves for each machine and tab in a round")
    parser.add_argument("--pause", type=float, default=0.0, help="idle seconds between rounds")
    arguments = parser.parse_args()
    begun = time.monotonic()
    print(f"{'minutes':>8}{'moves':>8}{'server MB':>11}{'page MB':>9}{'elements':>10}")
    for memory in soak(arguments.minutes, arguments.moves, pause_s=arguments.pause):
        minutes = (time.monotonic() - begun) / 60.0
        print(
            f"{minutes:8.1f}{memory.moves:8}{memory.server_MB:11.1f}{memory.page_MB:9.2f}{memory.elements:10}",
            flush=True,
        )


if __name__ == "__main__":
    main()
