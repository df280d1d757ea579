"""textile-twin published: the papers' numbers beside ours, and their figures drawn anew."""

from __future__ import annotations

import argparse
from pathlib import Path

from textile_twin_core.cli.arguments import Parser
from textile_twin_core.cli.outputs import save_json
from textile_twin_core.cli.places import check_output
from textile_twin_core.cli.progress import progress
from textile_twin_core.cli.published_table import as_json, as_markdown, as_text
from textile_twin_core.errors import OutputError
from textile_twin_core.files import check_folder, staged


def parser() -> Parser:
    """The command's arguments."""
    parser = Parser(
        "published",
        "The numbers that the four papers print, beside what their machines give here: deviation, and the reason"
        " where they differ.",
        "textile-twin published --plots figures",
    )
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw the papers' figures into this folder, as .png")
    parser.add_argument("--markdown", action="store_true", help="print the tables in Markdown")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows; is replaced when it is there")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Print the rows, write and draw what was asked for."""
    check_output("--json", arguments.json, ".json")
    if arguments.plots is not None:
        _make_folder(arguments.plots)
    if arguments.json is not None:
        save_json(arguments.json, as_json())
    print(as_markdown() if arguments.markdown else as_text())
    if arguments.plots is not None:
        names = _draw(arguments.plots)
        if not arguments.markdown:
            print(f"\n{arguments.plots}: {len(names)} figures")


def _make_folder(folder: Path) -> None:
    """Make the folder for the figures, or say why it cannot be written. Raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise OutputError(f"--plots {folder}: cannot make this folder ({why}); choose another") from error
    check_folder(folder / "figure.png")


def _draw(folder: Path) -> list[str]:
    """Draw every figure; their names."""
    from textile_twin_core.views.figures import FIGURES

    with progress(len(FIGURES), "drawing", unit=" figures", long=1) as done:
        for name, draw in FIGURES.items():
            with staged(folder / f"{name}.png") as partial:
                draw().savefig(partial)
            if done is not None:
                done(1)
    return list(FIGURES)
