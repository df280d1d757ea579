"""Documentation pages: their code blocks, with the marks before them, and their links."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path.relative_to(ROOT)
    for pattern in ("*.md", "docs/**/*.md", "bags/*.md", "tests/benchmarks/*.md", "ros2_ws/src/*/*.md")
    for path in ROOT.glob(pattern)
)

_FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.M | re.S)
_MARK = re.compile(r"^ *<!-- (not run|first|Ctrl-C after): (.+) -->\n$")


@dataclass(frozen=True)
class Block:
    """Code block of a page.

    A comment in the line above may carry instructions hidden from the reader: `<!-- not run: WHY -->`,
    `<!-- first: COMMAND -->` (a precondition of the page), `<!-- Ctrl-C after: TEXT -->` (the block runs until
    interrupted).
    """

    page: Path
    line: int
    language: str
    text: str
    marks: dict[str, str] = field(default_factory=dict)

    @property
    def place(self) -> str:
        """Position of the block, for messages."""
        return f"{self.page}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page, in order."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = []
    for match in _FENCE.finditer(text):
        above = text[: match.start()].splitlines(keepends=True)
        marks = {}
        while above and (mark := _MARK.match(above[-1])):
            marks[mark[1]] = mark[2]
            above.pop()
        indent, language, code = match.groups()
        lines = [line.removeprefix(indent) for line in code.splitlines(keepends=True)]
        found.append(Block(page, text[: match.start()].count("\n") + 1, language, "".join(lines), marks))
    return found


def prose(page: Path) -> str:
    """Return the page without its code blocks."""
    return _FENCE.sub("", (ROOT / page).read_text(encoding="utf-8"))
