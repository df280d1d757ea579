"""Commands and snippets of README and docs run as written and print the quoted output."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from tests.campaign import more
from tests.docs.pages import PAGES, Block, blocks
from tests.docs.workshop import furnish, run
from tests.ros.suite import free_domain

RUN = ("bash", "python")
Said = list[tuple[Block, str]]


WITH_CODE = [page for page in PAGES if any(block.language in RUN for block in blocks(page))]
LIVE = Path("docs/tutorials/live.md")
TUTORIALS = [page for page in WITH_CODE if page.parent.name == "tutorials" and page != LIVE]
FIRST = [Path("README.md"), *TUTORIALS]
"""What a new user reads; the other pages run with --all, that of the live suite, too: the README starts it."""


def run_page(page: Path, folder: Path) -> Said:
    """Run the blocks of a page in order in a folder of its own, and return the output of each."""
    folder.mkdir()
    furnish(folder)
    domain, claim = free_domain()
    with claim:
        return [
            (block, run(block, folder, domain))
            for block in blocks(page)
            if block.language in RUN and "not run" not in block.marks
        ]


@pytest.fixture(scope="module")
def running(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[Path, Future[Said]]]:
    """Run the requested pages side by side; the README, which takes longest, starts first."""
    here = (item for item in request.session.items if isinstance(item, pytest.Function) and item.path == request.path)
    wanted = {item.callspec.params["page"] for item in here}
    place = tmp_path_factory.mktemp("pages")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        yield {page: pool.submit(run_page, page, place / page.as_posix().replace("/", "_")) for page in sorted(wanted)}


@pytest.mark.slow
@pytest.mark.parametrize("page", [*FIRST, *more(*sorted({*WITH_CODE} - {*FIRST}))], ids=str)
def test_a_page_runs(page: Path, running: dict[Path, Future[Said]]) -> None:
    said = running[page].result()
    assert said or all("not run" in block.marks for block in blocks(page) if block.language in RUN)


@pytest.mark.slow
@pytest.mark.parametrize("page", [Path("README.md")], ids=str)
def test_the_demonstration_prints_what_the_readme_prints(page: Path, running: dict[Path, Future[Said]]) -> None:
    """Compare word by word. Numbers may differ by a tenth or by one in the last digit; the agreement of nodes
    and engine may
    differ within the stated bound; the note on gaps depends on the computer.
    """
    number = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:e[+-]\d+)?")
    (printed,) = (block.text for block in blocks(page) if block.language == "text")
    told = next(text for block, text in running[page].result() if "demo.sh" in block.text)
    lines = {number.sub("N", line): line for line in told.splitlines()}
    for line in filter(None, printed.splitlines()):
        assert number.sub("N", line) in lines, f"'{line}' is not among what demo.sh prints:\n{told}"
        seen = lines[number.sub("N", line)]
        for promised, found in (
            [] if line.startswith("note") else zip(number.findall(line), number.findall(seen), strict=True)
        ):
            last = 1e-9 if "e" in promised else 1.01 * 10.0 ** -len(promised.partition(".")[2])
            assert float(found) == pytest.approx(float(promised), rel=0.1, abs=last), f"{line}\n{seen}"


def shown(page: Path) -> list[tuple[Block, Block]]:
    """Commands of a page, each with the block of its output below."""
    pairs = itertools.pairwise(blocks(page))
    return [
        (one, two)
        for one, two in pairs
        if one.language in RUN and two.language == "text" and "not run" not in one.marks
    ]


@pytest.mark.slow
@pytest.mark.parametrize("page", [*TUTORIALS, *more(LIVE)], ids=str)
def test_a_tutorial_shows_what_its_commands_print(page: Path, running: dict[Path, Future[Said]]) -> None:
    """Compare line by line: the first column, and the first number behind it within a tenth."""
    number = re.compile(r"[+-]?\d+(?:\.\d+)?(?:e[+-]\d+)?")
    printed = {block.line: text for block, text in running[page].result()}
    assert shown(page)
    for command, output in shown(page):
        for line in output.text.splitlines():
            label, *promised = re.split(r" {2,}", line)
            lines = [each for each in printed[command.line].splitlines() if label in each]
            assert lines, f"{output.place}: '{label}' is not among what it prints:\n{printed[command.line]}"
            if promised and number.match(promised[0]):
                seen = number.findall(lines[0].split(label, 1)[1])
                assert float(seen[0]) == pytest.approx(float(number.findall(promised[0])[0]), rel=0.1), lines[0]
