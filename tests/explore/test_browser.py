"""Design page in headless Chromium: the steps of a person from opening it to the end of the server."""

from __future__ import annotations

import cmath
import math
import statistics
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.select import Select

import textile_twin_core as ttc
from tests.campaign import more
from tests.explore.browser import CHROMIUM, DRIVER, Page, served
from tests.explore.soak import soak
from textile_twin_core.dynamics.loads import ForceCurve
from textile_twin_core.files.machine_file import machine_document

BAG = Path(__file__).resolve().parents[2] / "bags" / "tufting_160rpm_synthetic"

pytestmark = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="no chromium with chromium-driver here (apt-get install chromium chromium-driver)"
)


@pytest.fixture(scope="module")
def downloads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("downloads")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with served("elliptic_gear_beatup") as (_, address):
        yield address


@pytest.fixture(scope="module")
def browser(downloads: Path) -> Iterator[Page]:
    page = Page(downloads=downloads)
    yield page
    page.close()


@pytest.fixture
def page(browser: Page, address: str) -> Iterator[Page]:
    """Open a fresh page, and check at the end that the browser has no errors."""
    browser.open(address)
    browser.driver.execute_script("sessionStorage.clear()")
    browser.open(address)
    yield browser
    assert browser.complaints == []


def test_opens_with_the_paper_s_numbers_and_printed_values_beside(page: Page) -> None:
    assert "token" not in page.driver.current_url and "elliptic gear" in page.driver.title
    assert page.number("sley_stroke_m") == pytest.approx(84.991, abs=1e-3)
    assert page.number("sley_front_acceleration_m_s2") == pytest.approx(610.82, abs=0.01)
    assert page.number("sley_dwell_rad") == pytest.approx(200.0, abs=0.5)
    assert page.text("[data-number='sley_front_acceleration_m_s2'] .printed") == "615.8434"
    assert page.text("[data-number='sley_stroke_m'] .printed") == "85"


def test_slider_moves_curve_and_numbers_and_undo_takes_the_drag_back(page: Page) -> None:
    slider = page.find("#s_coupler_m")
    before, stroke = page.curve("Acceleration"), page.number("sley_stroke_m")
    page.answered(lambda: slider.send_keys(Keys.ARROW_RIGHT))
    taken = [page.moved("s_coupler_m", 100.0 + 0.2 * k).painted_ms for k in range(8)]
    print(f"from slider to painted curves: {statistics.median(taken):.0f} ms (median of {len(taken)})")
    assert page.curve("Acceleration") != before and page.number("sley_stroke_m") != stroke
    assert not page.find("[data-number='sley_stroke_m']").find_elements(By.CSS_SELECTOR, ".printed")
    while page.find("#undo").is_enabled():
        page.answered(lambda: page.find("#undo").click())
    assert page.number("sley_stroke_m") == stroke and page.curve("Acceleration") == before


def test_geometry_that_cannot_close_and_nonsense_leave_the_page_alive(page: Page) -> None:
    page.answered(lambda: page.type("p_rocker_m", "60"))
    assert "opens at a shaft angle of 4.8676 deg" in page.text("#problem")
    page.answered(lambda: page.type("p_rocker_m", "180"))
    assert not page.find("#problem").is_displayed()
    states = page.states
    page.type("p_rocker_m", "1e")
    assert page.find("#p_rocker_m").get_attribute("aria-invalid") == "true"
    assert "no number" in page.text("#banner") and page.states == states
    page.type("rpm", "-3")
    page.until(lambda: "must lie between" in page.text("#banner"))
    page.answered(lambda: page.type("p_rocker_m", "181"))
    assert page.find("#p_rocker_m").get_attribute("aria-invalid") == "false"
    page.answered(lambda: page.find("#undo").click())


def test_saved_machine_is_read_by_the_package_and_loaded_again(page: Page, downloads: Path) -> None:
    page.answered(lambda: page.type("p_crank_m", "41"))
    stroke = page.number("sley_stroke_m")
    page.find(".menu summary").click()
    page.find("[data-file=yaml]").click()
    saved = downloads / "elliptic_gear_beatup.yaml"
    page.until(saved.exists)
    assert ttc.load_machine(saved).parameters["crank_m"] == pytest.approx(0.041)
    for kind in ("json", "csv", "svg", "png", "dxf"):
        page.find(".menu summary").click()
        page.find(f"[data-file={kind}]").click()
        page.until(lambda kind=kind: [*downloads.glob(f"*.{kind}")])
    page.answered(lambda: page.find("#reset").click())
    assert page.number("sley_stroke_m") != stroke
    page.answered(lambda: page.find("#loaded").send_keys(str(saved)))
    assert page.number("sley_stroke_m") == stroke


def test_search_shows_its_front_stops_and_a_point_becomes_the_design(page: Page) -> None:
    for parameter in ("crank_m", "coupler_m", "axis_ratio", "past_largest_ratio_rad"):
        page.tick(parameter)
    page.find("#start").click()
    page.until(lambda: page.driver.find_elements(By.CSS_SELECTOR, "#front circle"))
    page.until(lambda: page.find("#stop").is_enabled())
    page.find("#stop").click()
    page.until(lambda: "done in" in page.text("#search_says"))
    assert "designs looked at" in page.text("#search_says") and page.find("#start").is_enabled()
    before = page.number("sley_dwell_rad")
    points = page.driver.find_elements(By.CSS_SELECTOR, "#front circle")
    page.answered(lambda: points[-1].send_keys(Keys.ENTER))
    assert page.number("sley_dwell_rad") > before
    page.find("#tab_tolerance").click()
    page.find("#tolerate").click()
    page.until(lambda: page.driver.find_elements(By.ID, "scrap"))
    assert "Scrap rate" in page.text("#scrap")


def test_a_knot_of_a_force_curve_is_dragged_and_undone(browser: Page, tmp_path: Path) -> None:
    page, file = browser, tmp_path / "needles.yaml"
    law = ForceCurve("cloth", "needle_position_m", (0.559, 0.565, 0.58), (500.0, 600.0, 500.0), (200.0,) * 3)
    file.write_text(yaml.safe_dump(machine_document(replace(ttc.machines.tufting(), loads=(law,)))))
    with served(str(file)) as (_, address):
        page.open(address)
        knot, peak, line = (
            page.find("[data-knot='cloth/in/1']"),
            page.number("peak_torque_Nm"),
            page.find("[data-force]"),
        )
        before = line.get_attribute("d")
        drag = ActionChains(page.driver).click_and_hold(knot)
        for _ in range(4):
            drag.move_by_offset(0, -5)
        page.answered(lambda: drag.release().perform())
        page.until(
            lambda: float(knot.get_attribute("aria-valuenow") or 0) > 650.0 and page.number("peak_torque_Nm") > peak
        )
        assert line.get_attribute("d") != before
        page.answered(lambda: page.find("#undo").click())
        assert float(knot.get_attribute("aria-valuenow") or 0) == 600.0 and page.number("peak_torque_Nm") == peak
        page.answered(lambda: knot.send_keys(Keys.ARROW_UP))
        assert 600.0 < float(knot.get_attribute("aria-valuenow") or 0) < 620.0
    page.driver.get("about:blank")
    assert [each for each in page.complaints if "WebSocket" not in each] == []


@pytest.mark.slow
def test_hands_on_the_tufting_machine_under_its_recording(browser: Page) -> None:
    page = browser
    with served("tufting", "--recording", str(BAG)) as (_, address):
        page.open(address)
        assert len(page.find("#charts .recording").get_attribute("d") or "") > 1000
        linkage = page.find("#linkage")

        def angle() -> float:
            return float(linkage.get_attribute("aria-valuenow") or "nan")

        _drag_the_crank(page, 50.0)
        assert angle() == pytest.approx(50.0, abs=3.0)
        ActionChains(page.driver).move_to_element(page.find(".chart")).click().perform()
        assert 140.0 < angle() < 200.0
        page.type("coupler_along", "60")
        page.type("coupler_across", "30")
        assert len(page.find("#linkage .coupler").get_attribute("d") or "") > 100
        page.answered(lambda: page.find("#pin").click())
        page.answered(lambda: page.type("p_l1_m", "17"))
        shown = page.text("[data-number=needle_stroke_m]").split()
        assert shown == ["needle", "stroke", "37.155", "32.788", "mm"]
        page.answered(lambda: page.find("body").send_keys(Keys.CONTROL + "z"))
        page.moved("s_l2_m", 0.5 * 138.0)  # beyond a change point, and back
        assert "it opens at a shaft angle of" in page.text("#problem")
        page.moved("s_l2_m", 138.0)
        assert not page.find("#problem").is_displayed() and page.number("needle_stroke_m") == pytest.approx(32.788)
        page.find("#tab_tolerance").click()
        page.find("#sense").click()
        page.until(lambda: "backing" not in page.text("#spread") and "entry plane" in page.text("#spread"))
        page.find("#tab_balance").click()
        page.answered(lambda: page.find("[data-balance=counterweight]").click())
        assert "RMS gravity torque 0.3936 to 0.00461 N m" in page.text("#balance_says")
        page.driver.get("about:blank")  # before the server ends
        assert page.complaints == []


def _drag_the_crank(page: Page, degrees: float) -> None:
    """Drag the line of the crank with the mouse about its pivot, far out for precision."""
    places = page.driver.execute_script(
        "return Object.fromEntries([...document.querySelectorAll('#linkage text')].map("
        "t => [t.textContent, [+t.getAttribute('x') - 7, +t.getAttribute('y') + 7]]))"
    )
    pivot, end = complex(*places["O"]), complex(*places["A"])
    linkage = page.find("#linkage")
    middle = complex(linkage.rect["width"], linkage.rect["height"]) / 2.0
    hand = ActionChains(page.driver)
    for k in range(6):
        place = pivot + 10.0 * (end - pivot) * cmath.exp(-1j * math.radians(degrees * k / 5)) - middle
        hand.move_to_element_with_offset(linkage, round(place.real), round(place.imag))
        if k == 0:
            hand.click_and_hold()
    hand.release().perform()


_LAID_OUT = """
const box = document.querySelector(".menu > div").getBoundingClientRect(), root = document.documentElement;
const words = [...document.querySelectorAll(".parameter label.name")].filter((label) => {
  const text = label.firstChild, range = document.createRange();
  return [...text.data.matchAll(/[^\\s.]+/g)].some((word) => {
    range.setStart(text, word.index);
    range.setEnd(text, word.index + word[0].length);
    return range.getClientRects().length > 1;
  });
});
return {
  menu: [box.left, box.right, root.clientWidth],
  wide: root.scrollWidth,
  broken: words.map((label) => label.textContent),
  slider: Math.min(...[...document.querySelectorAll(".parameter input[type=range]")].map((one) => one.clientWidth)),
  ticks: [...document.querySelectorAll(".chart")].map((chart) => [...chart.querySelectorAll("g text")]
    .filter((text) => text.getAttribute("text-anchor") === "end").map((text) => text.textContent)),
  rpm: document.getElementById("rpm").value,
};
"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, *more(1500)])
def test_a_machine_of_one_s_own_is_laid_out_on_any_screen(width: int, browser: Page, tmp_path: Path) -> None:
    """Show a rocker arm with an almost constant reduced inertia, at a speed that is not a round number of rpm."""
    pump = (Path(__file__).resolve().parents[2] / "examples" / "beam_pump.yaml").read_text()
    file = tmp_path / "pump.yaml"
    file.write_text(pump.replace("nominal_speed_rad_s: 1.0472", "nominal_speed_rad_s: 6.3"))
    page = browser
    if width < 500:
        page.as_phone(width, 844)
    try:
        with served(str(file), XDG_CACHE_HOME=str(tmp_path)) as (_, address):
            page.open(address)
            page.find(".menu summary").click()
            shown = page.driver.execute_script(_LAID_OUT)
            page.driver.get("about:blank")
    finally:
        page.as_window()
    left, right, edge = shown["menu"]
    assert 0 <= left < right <= edge and shown["wide"] <= edge
    assert shown["broken"] == [] and shown["slider"] > 200
    assert shown["rpm"] == "60.16"
    assert all(len(set(ticks)) == len(ticks) for ticks in shown["ticks"])


def test_ticks_of_a_narrow_range_differ(page: Page) -> None:
    made = page.driver.execute_async_script("""
        const done = arguments[0];
        import("/page/dom.js").then((dom) => done([
          dom.apart([46.8401, 46.8402, 46.8403]), dom.apart([0, 20, 40]), dom.apart([-1e-9, 0, 1e-9]),
        ])).catch((error) => done(String(error)));""")
    assert made == [["46.8401", "46.8402", "46.8403"], ["0", "20", "40"], ["-1e-9", "0", "1e-9"]]


def test_two_tabs_hold_two_designs(page: Page, address: str) -> None:
    first = page.driver.current_window_handle
    page.answered(lambda: page.type("p_crank_m", "42"))
    stroke = page.number("sley_stroke_m")
    page.driver.switch_to.new_window("tab")
    page.open(address)
    assert page.number("sley_stroke_m") == pytest.approx(84.991, abs=1e-3)
    page.answered(lambda: page.type("p_crank_m", "38"))
    page.driver.close()
    page.driver.switch_to.window(first)
    assert page.number("sley_stroke_m") == stroke


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tufting", *more("handloom_beatup", "needle_transfer", "elliptic_gear_beatup")])
def test_every_machine_moves_and_fits_a_phone(page: Page, name: str) -> None:
    if name != "elliptic_gear_beatup":
        # the loops of the needle transfer may have to be compiled first
        page.answered(lambda: Select(page.find("#machine")).select_by_value(name), seconds=400.0)
    page.until(lambda: name.replace("_", " ") in page.driver.title)
    lines = page.driver.find_elements(By.CSS_SELECTOR, "#linkage [data-link]")
    before = [line.get_attribute("x2") for line in lines]
    assert len(lines) >= 3 and page.driver.find_elements(By.CSS_SELECTOR, ".chart")
    page.find("#linkage").send_keys(Keys.SHIFT + Keys.ARROW_RIGHT * 4)
    assert float(page.find("#linkage").get_attribute("aria-valuenow") or 0) == pytest.approx(40.0)
    after = [line.get_attribute("x2") for line in page.driver.find_elements(By.CSS_SELECTOR, "#linkage [data-link]")]
    assert after != before or name == "needle_transfer"  # its elements move straight down
    page.as_phone(360, 740)
    wide = page.driver.execute_script(
        "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    )
    page.as_window()
    assert wide <= 0


@pytest.mark.slow
def test_without_the_token_there_is_nothing_and_the_end_of_the_server_is_said(browser: Page) -> None:
    page = browser
    with served("handloom_beatup") as (_, address):
        page.driver.get(address.split("?")[0])
        assert "needs the address with its token" in page.text("body")
        page.open(address)
    page.until(lambda: "trying again" in page.text("#banner"))
    page.find("#play").click()
    page.until(lambda: float(page.find("#linkage").get_attribute("aria-valuenow") or 0) > 1.0)
    page.driver.get("about:blank")
    assert page.complaints  # of the server that is gone; read here, so that no other test meets them


@pytest.mark.slow
@pytest.mark.campaign
def test_page_left_open_comes_back_from_lost_connections_and_sleep_and_uses_no_more_memory() -> None:
    """Run the short form of `python -m tests.explore.soak`."""
    memory = list(soak(minutes=10.0, moves=10, names=("elliptic_gear_beatup",), rounds=3))
    assert len(memory) == 3 and memory[-1].moves == 3 * 2 * 10
    assert memory[2].elements < 1.5 * memory[1].elements and memory[2].page_MB < memory[1].page_MB + 1.5
    assert memory[2].server_MB < memory[1].server_MB + 25.0
