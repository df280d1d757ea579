"""Links, anchors, commands and blocks of the pages: every target exists."""

from __future__ import annotations

import importlib.util
import os
import re
import tomllib
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT, blocks, prose
from textile_twin_core.cli.main import main
from textile_twin_core.cli.published_table import published_rows

PLACE = re.compile(r"(?<![\w/.])(?:docs|examples|ros2_ws|bags|tests|launch_scripts|textile_twin_core)/[\w./-]*\w")
COUNTS = re.compile(r"(\d+) numbers of the four papers, of which (\d+) agree, (\d+) differ .*? and (\d+) are", re.S)
MADE_LATER = ("ros2_ws/install", "ros2_ws/.venv")
LINK = re.compile(r"\]\(([^)\s]+)\)")
COMMAND = re.compile(r"textile-twin ([a-z]+)([^\n`#|]*)")
WITH_TASKS = ("synthesize",)
LANGUAGES = {"bash", "python", "yaml", "text"}

each_page = pytest.mark.parametrize("page", PAGES, ids=str)


def anchors(text: str) -> set[str]:
    """Return the anchors that GitHub generates for the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@each_page
def test_a_link_leads_somewhere(page: Path) -> None:
    for target in LINK.findall(prose(page)):
        if "://" in target:
            assert target.startswith("https://"), target
            continue
        path, _, anchor = target.partition("#")
        there = (ROOT / page).parent / path if path else ROOT / page
        assert there.resolve().is_relative_to(ROOT) and there.exists(), f"{page}: {target}"
        if anchor:
            assert anchor in anchors(prose(there.resolve().relative_to(ROOT))), f"{page}: {target}"


@each_page
def test_a_path_or_module_in_its_text_is_there(page: Path) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for path in re.findall(
        r"(?<![\w/.])(?:docs|examples|ros2_ws|bags|tests|launch_scripts|textile_twin_core)/[\w./-]*\w", text
    ):
        assert (ROOT / path).exists() or path.startswith(MADE_LATER), f"{page}: {path}"
    for module in re.findall(r"python -m (tests\.[\w.]+)", text):
        assert importlib.util.find_spec(module) is not None, f"{page}: {module}"


@each_page
def test_its_commands_and_options_are_there(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Check the commands in running text too, which are not run."""
    for command, rest in sorted(set(COMMAND.findall((ROOT / page).read_text(encoding="utf-8")))):
        task = re.findall("^ ([a-z-]+)", rest) if command in WITH_TASKS else []
        with pytest.raises(SystemExit) as stop:
            main([command, *task, "--help"])
        assert stop.value.code == 0, f"{page}: textile-twin {command}{rest}"
        told = capsys.readouterr().out
        for option in re.findall(r"--[a-z-]+", rest):
            assert option == "--help" or option in told, f"{page}: textile-twin {command} {option}"


@each_page
def test_every_block_says_its_language(page: Path) -> None:
    """Check that all code is fenced, since indented code is not run."""
    assert {block.language for block in blocks(page)} <= LANGUAGES
    assert not re.search(r"\n\n {4,}(?![-*|\d])\S", prose(page)), "an indented block: give it a fence and a language"


def test_scripts_can_be_started() -> None:
    for script in (ROOT / "launch_scripts").glob("*.sh"):
        assert os.access(script, os.X_OK) == script.read_text().startswith("#!"), script


def test_the_readme_is_short_and_counts_rightly() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert text.count("\n") <= 200
    agree = [row.agrees for row in published_rows()]
    said = COUNTS.search(text)
    assert said is not None
    assert [int(n) for n in said.groups()] == [len(agree), agree.count(True), agree.count(False), agree.count(None)]


def test_the_drawing_of_the_layers_is_the_contract() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    (drawing,) = (block.text for block in blocks(Path("docs/architecture.md")) if block.language == "text")
    assert re.findall(r"^ {3}(\w+(?: \| \w+)*)(?:  .*)?$", drawing, re.M) == layers


def test_what_the_architecture_names_is_there() -> None:
    """Check files by their path below the package, or in the folder of the file named before them in the row."""
    package = ROOT / "textile_twin_core"
    for row in re.findall(r"^\| [^|]+ \| (.+) \|$", (ROOT / "docs" / "architecture.md").read_text(), re.M):
        folder = package
        for path in re.findall(r"`([\w/]+\.py)`", row):
            place = next((up / path for up in (folder, package, ROOT) if (up / path).exists()), None)
            assert place is not None, path
            folder = place.parent


def test_every_page_can_be_reached_from_the_readme() -> None:
    reached, ahead = set(), [Path("README.md")]
    while ahead:
        page = ahead.pop()
        reached.add(page)
        for target in LINK.findall(prose(page)):
            path = ((ROOT / page).parent / target.split("#")[0]).resolve()
            if path.suffix == ".md" and path.is_relative_to(ROOT) and (new := path.relative_to(ROOT)) not in reached:
                ahead.append(new)
    assert reached == set(PAGES)
