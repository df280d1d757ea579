"""Hooks of the docs site: pages that live outside docs/, their links, and the command line from its parsers."""

from __future__ import annotations

import argparse
import os
import re
from importlib import import_module
from pathlib import Path, PurePosixPath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from textile_twin_core.cli.main import COMMANDS, module_of

ROOT = Path(__file__).resolve().parents[1]
OUTSIDE = {
    "README.md": "overview.md",
    "bags/README.md": "reference/recordings.md",
    "ros2_ws/src/textile_twin_ros/README.md": "reference/nodes.md",
    "tests/benchmarks/README.md": "project/benchmarks.md",
    "ros2_ws/src/textile_twin_ros/CONTACT.md": "project/contact.md",
    "ros2_ws/src/textile_twin_ros/QUALITY_DECLARATION.md": "project/quality.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "CHANGELOG.md": "project/changelog.md",
}
"""Pages outside docs/, by their path in the repository, and their place on the site."""
COMMAND_LINE = "<!-- command line -->"
PYTHON = "reference/python.md"
"""Page whose entries are headed by the path to import them from."""

_INSIDE = {place: path for path, place in OUTSIDE.items()}
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
_REFERENCE = re.compile(r"^::: (\S+)\n", re.M)
_FENCE = re.compile(r"^( *)```.*?^\1```$", re.M | re.S)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages outside docs/."""
    for path, place in OUTSIDE.items():
        files.append(File.generated(config, place, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn a page of the repository into a page of the site."""
    place = page.file.src_uri
    if COMMAND_LINE in markdown:
        markdown = markdown.replace(COMMAND_LINE, command_line())
    if place in OUTSIDE.values():  # GitHub indents what belongs to a numbered item by three, Python-Markdown by four
        markdown = re.sub(r"^ {3}(?=\S)|^ {3}$", "    ", markdown, flags=re.M)
    if page.file.src_uri == PYTHON:
        markdown = _REFERENCE.sub(with_import_path, markdown)
    markdown = markdown.replace("<details>", '<details markdown="1">')
    code = [match.span() for match in _FENCE.finditer(markdown)]
    return _LINK.sub(
        lambda link: link[0] if any(a <= link.start() < b for a, b in code) else relinked(link, place), markdown
    )


def relinked(link: re.Match[str], place: str) -> str:
    """A link of a page, as it is on the site; of a file that the site does not have the text alone.

    Args:
        link: match of `![text](target)`.
        place: path of the page on the site.

    Examples:
        >>> relinked(_LINK.match("[papers](docs/papers.md#looms)"), "overview.md")
        '[papers](papers.md#looms)'
    """
    picture, text, target = link.groups()
    path, _, anchor = target.partition("#")
    if not path or "://" in target:
        return link[0]
    here = PurePosixPath(_INSIDE.get(place, f"docs/{place}"))
    there = os.path.normpath(here.parent / path)
    if there in OUTSIDE:
        goal = OUTSIDE[there]
    elif there.startswith("docs/"):
        goal = there.removeprefix("docs/")
    else:
        return f"{text} (`{there}`)" if (ROOT / there).exists() else link[0]
    goal = os.path.relpath(goal, PurePosixPath(place).parent)
    return f"{picture}[{text}]({goal}{'#' * bool(anchor)}{anchor})"


def with_import_path(entry: re.Match[str]) -> str:
    """Head an entry of the Python reference by the path to import it from."""
    path = import_path(entry[1])
    name = path.rpartition(".")[2]
    return f"::: {entry[1]}\n    options: {{heading: {path}, toc_label: {name}}}\n"


def import_path(place: str) -> str:
    """Return the shortest path from which a name can be imported.

    Args:
        place: dotted path of the module that defines it, and its name.

    Examples:
        >>> import_path("textile_twin_core.twin.compilation.compile_machine")
        'textile_twin_core.compile'
    """
    module, _, name = place.rpartition(".")
    parts = module.split(".")
    found = getattr(import_module(module), name)
    for length in range(1, len(parts)):
        package = import_module(".".join(parts[:length]))
        for public in getattr(package, "__all__", ()):
            if getattr(package, public) is found:
                return f"{package.__name__}.{public}"
    return place


def command_line() -> str:
    """Every command with its help, from its argument parser, in Markdown."""
    os.environ["COLUMNS"] = "100"
    return "\n".join(
        part
        for name, purpose in COMMANDS.items()
        for part in _command(import_module(module_of(name)).parser(), purpose)
    )


def _command(parser: argparse.ArgumentParser, purpose: str, level: int = 2) -> list[str]:
    name = parser.prog.removeprefix("textile-twin ")
    parts = (
        [f"{'#' * level} {name}\n", f"{purpose[:1].upper()}{purpose[1:]}.\n"]
        if purpose
        else [f"{'#' * level} {name}\n"]
    )
    parts.append(f"```text\n{parser.format_help().rstrip()}\n```\n")
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for task in action.choices.values():
                parts += _command(task, "", level + 1)
    return parts
