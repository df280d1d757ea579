"""Redraw the pictures of docs/explore.md: python -m tests.explore.screenshots"""

from __future__ import annotations

import io
from pathlib import Path

from PIL import Image
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tests.explore.browser import Page, served

DOCS = Path(__file__).resolve().parents[2] / "docs"
BAG = DOCS.parent / "bags" / "tufting_160rpm_synthetic"


def main() -> None:
    """Draw all pictures."""
    with served("tufting", "--recording", str(BAG)) as (_, address):
        _picture("tufting", address, 60)
    with served("handloom_beatup") as (_, address):
        _picture("handloom_beatup", address, 100, _spring)
    with served("needle_transfer") as (_, address):
        _picture("needle_transfer", address, 24)
    with served("elliptic_gear_beatup") as (_, address):
        _picture("elliptic_gear_beatup", address, 40, _search, "1500,1690")
        _picture("phone", address, 40, _phone)


def _picture(name: str, address: str, degrees: float, act=None, size: str = "1500,1300") -> None:  # type: ignore[no-untyped-def]
    page = Page(size)
    try:
        page.open(address)
        if act:
            act(page)
        page.driver.execute_script(
            "const a = document.getElementById('angle'); a.value = arguments[0]; a.dispatchEvent(new Event('input'));"
            "document.activeElement.blur(); scrollTo(0, 0)",
            degrees,
        )
        image = Image.open(io.BytesIO(page.driver.get_screenshot_as_png())).convert("RGB")
        image.quantize(192, dither=Image.Dither.NONE).save(DOCS / f"explore_{name}.png", optimize=True)
    finally:
        page.close()


def _spring(page: Page) -> None:
    page.find("#tab_balance").click()
    page.answered(lambda: page.find("[data-balance=spring]").click())


def _search(page: Page) -> None:
    page.answered(lambda: page.find("#pin").click())
    for parameter in ("crank_m", "coupler_m", "rocker_m", "axis_ratio", "past_largest_ratio_rad"):
        page.tick(parameter)
    page.find("#seconds").clear()
    page.find("#seconds").send_keys("300")
    page.find("#start").click()
    page.until(lambda: "done in" in page.text("#search_says"), 300)
    points = page.driver.find_elements(By.CSS_SELECTOR, "#front circle")
    wanted = [p for p in points if float((p.get_attribute("aria-label") or "").split("rear ")[1].split(" ")[0]) > 205.0]
    page.answered(lambda: wanted[0].send_keys(Keys.ENTER))


def _phone(page: Page) -> None:
    page.as_phone(390, 844)
    page.find("#theme").click()


if __name__ == "__main__":
    main()
