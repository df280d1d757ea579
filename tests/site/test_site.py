"""The docs site: built without a warning, readable without a network, with a search that works from the disk."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("mkdocs", reason="no mkdocs here (pip install '.[docs]')")
pytest.importorskip("material")

from selenium.webdriver.common.by import By

from launch_scripts.site_pages import OUTSIDE
from tests.docs.pages import PAGES, ROOT
from tests.explore.browser import CHROMIUM, DRIVER, Page
from textile_twin_core.cli.main import COMMANDS

OUTSIDE_ADDRESS = re.compile(r"""<(?:script|img|link|iframe|source)\b[^>]*\b(?:src|href)=["']?(?:https?:)?//[^"'> ]*""")
"""What a page would load from elsewhere; a link that a person may follow is `<a>`."""
IN_STYLE = re.compile(r"url\((?:[\"']?)(?:https?:)?//|@import")
PHONE = (390, 844)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as docs.sh builds it."""
    folder = tmp_path_factory.mktemp("site")
    command = [ROOT / "launch_scripts" / "docs.sh", folder]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.strip() == str(folder / "index.html")
    return folder


def test_every_page_of_the_repository_is_on_the_site(site: Path) -> None:
    for page in PAGES:
        place = OUTSIDE.get(page.as_posix()) or page.relative_to("docs").as_posix()
        assert (site / place).with_suffix(".html").is_file(), page


def test_no_page_needs_anything_from_elsewhere(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) >= len(PAGES)
    for page in pages:
        assert OUTSIDE_ADDRESS.findall(page.read_text()) == [], page
    for style in site.rglob("*.css"):
        assert not IN_STYLE.search(style.read_text()), style


def test_the_command_line_is_that_of_the_commands(site: Path) -> None:
    page = (site / "reference" / "command_line.html").read_text()
    for command in COMMANDS:
        assert f"usage: textile-twin {command}" in page, command


def test_the_python_reference_has_signatures_and_docstrings(site: Path) -> None:
    listed = re.findall("^::: (.+)$", (ROOT / "docs" / "reference" / "python.md").read_text(), re.M)
    page = (site / "reference" / "python.html").read_text()
    for name in listed:
        assert f'id="{name}"' in page, name
    assert "Example:" not in page  # which the site would show as plain text
    assert page.count("<strong>Examples:</strong>") + page.count("Examples:") >= len(listed) - 10
    headings = re.findall(r"textile_twin_core\.[\w.]+(?=\s*<)", page)
    assert {"textile_twin_core.compile", "textile_twin_core.Machine", "textile_twin_core.load_machine"} <= set(headings)


@pytest.fixture(scope="module")
def browser() -> Iterator[Page]:
    if not (CHROMIUM and DRIVER):
        pytest.skip("no chromium with chromium-driver here (apt-get install chromium chromium-driver)")
    page = Page(size="1400,1000")
    yield page
    page.close()


def test_search_works_from_the_disk(site: Path, browser: Page) -> None:
    browser.driver.get((site / "index.html").as_uri())
    browser.find("[data-md-component=search-query]").send_keys("encoder_zero")
    browser.until(lambda: browser.driver.find_elements(By.CSS_SELECTOR, ".md-search-result__item a"))
    hit = browser.find(".md-search-result__item a")
    assert "encoder_zero" in hit.get_attribute("href")  # highlighted there
    browser.driver.get(hit.get_attribute("href"))
    browser.until(lambda: browser.driver.find_elements(By.CSS_SELECTOR, "mark[data-md-highlight]"))
    assert browser.complaints == []


@pytest.mark.campaign
def test_pages_fit_a_phone(site: Path, browser: Page) -> None:
    """Pages are as wide as the screen; wide tables and code scroll by themselves."""
    browser.as_phone(*PHONE)
    for page in sorted(set(site.rglob("*.html")) - {site / "404.html"}):  # which a server shows at any address
        browser.driver.get(page.as_uri())
        width = browser.driver.execute_script("return document.documentElement.scrollWidth")
        assert width == PHONE[0], f"{page.relative_to(site)} is {width} wide"
        broken = "return [...document.images].filter(i => i.complete && !i.naturalWidth).map(i => i.src)"
        assert browser.driver.execute_script(broken) == [], page
    browser.as_window()
    assert browser.complaints == []
