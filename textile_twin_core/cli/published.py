"""textile-twin published: the papers' numbers beside ours, and their figures redrawn."""

from __future__ import annotations

import argparse
from pathlib import Path

from textile_twin_core.cli.arguments import Parser
from textile_twin_core.cli.outputs import check_outputs, save_json
from textile_twin_core.cli.progress import progress
from textile_twin_core.cli.published_table import as_json, as_markdown, as_text
from textile_twin_core.errors import OutputError
from textile_twin_core.files import check_folder, staged


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "published",
        "The numbers that the four papers print, beside what their machines give here: deviation, and the reason"
        " where they differ.",
        "textile-twin published --plots figures",
    )
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw the papers' figures into this folder, as .png")
    parser.add_argument("--markdown", action="store_true", help="print the tables in Markdown")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows; overwritten if it exists")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Print the rows, and write and draw the outputs."""
    check_outputs(arguments)
    if arguments.plots is not None:
        _make_folder(arguments.plots)
    save_json(arguments.json, as_json())
    print(as_markdown() if arguments.markdown else as_text())
    if arguments.plots is not None:
        names = _draw(arguments.plots)
        if not arguments.markdown:
            print(f"\n{arguments.plots}: {len(names)} figures")


def _make_folder(folder: Path) -> None:
    """Create the folder for the figures.

    Raises:
        OutputError: The folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise OutputError(f"--plots {folder}: cannot make this folder ({why}); choose another") from error
    check_folder(folder / "figure.png")


def _draw(folder: Path) -> list[str]:
    """Draw every figure, and return their names."""
    from textile_twin_core.views.figures import FIGURES

    with progress(len(FIGURES), "drawing", unit=" figures", long=1) as done:
        for name, draw in FIGURES.items():
            with staged(folder / f"{name}.png") as partial:
                draw().savefig(partial)
            if done is not None:
                done(1)
    return list(FIGURES)
