"""textile-twin published: the table in three forms, docs/papers.md, and the figures."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
import termios
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from textile_twin_core.cli.main import main
from textile_twin_core.cli.published_table import as_markdown, published_rows
from textile_twin_core.views.figures import FIGURES

PAGE = Path(__file__).parents[2] / "docs" / "papers.md"
BEGIN, END = "<!-- published:begin -->", "<!-- published:end -->"


@pytest.mark.slow
def test_table_for_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["published"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    line = next(line for line in lines if "t4, smallest" in line)
    assert line.split()[-4:] == ["deg", "-7.89", "-7.678", "+0.212"]
    assert "misprint" in lines[lines.index(line) + 1]
    for year in (
        "Xu et al. 2016",
        "Topalbekiroglu and Celik 2010",
        "Pejchar and Beran 2011",
        "Zhao, Ren and Chen 2011",
    ):
        assert any(line.startswith(year) for line in lines)
    assert lines[-1].startswith(f"{len(published_rows())} rows: ")


def test_no_row_without_agreement_or_reason() -> None:
    for row in published_rows():
        assert row.agrees is not False or row.reason, row
        assert row.section and row.quantity, row
    places = [(row.paper, row.section, row.quantity) for row in published_rows()]
    assert len(places) == len(set(places))


def test_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "published.json"
    assert main(["published", "--json", str(out)]) == 0
    rows = json.loads(out.read_text())["rows"]
    assert len(rows) == len(published_rows())
    stroke = next(row for row in rows if row["quantity"] == "stroke of the needle")
    assert stroke["computed"] == pytest.approx(32.7884, abs=1e-4) and stroke["printed"] == "about 33"
    table = next(row for row in rows if row["quantity"] == "phi 180, beta 48")
    assert table["agrees"] and table["computed"][2] == pytest.approx(0.7694, abs=1e-4)


def test_the_page_carries_what_is_computed(capsys: pytest.CaptureFixture[str]) -> None:
    """Compare docs/papers.md with the output of textile-twin published --markdown; after a change, paste it
    between the markers.
    """
    text = PAGE.read_text(encoding="utf-8")
    assert text.count(BEGIN) == text.count(END) == 1
    block = text.split(BEGIN)[1].split(END)[0].strip()
    assert block == as_markdown().strip()
    assert main(["published", "--markdown"]) == 0
    assert capsys.readouterr().out.strip() == block


@pytest.mark.campaign
@pytest.mark.slow
def test_figures_and_a_progress_bar_on_a_terminal(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "figures"
    code = "import sys; from textile_twin_core.cli.main import main; sys.exit(main(sys.argv[1:]))"
    terminal, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    command = [sys.executable, "-c", code, "published", "--plots", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs) as running:
        os.close(theirs)
        said = running.communicate()[0].decode()
    bar = os.read(terminal, 65536)
    os.close(terminal)
    assert running.returncode == 0, bar
    assert said.rstrip().endswith(f"{folder}: {len(FIGURES)} figures")
    assert b"drawing" in bar and b"figures" in bar
    assert sorted(path.name for path in folder.iterdir()) == sorted(f"{name}.png" for name in FIGURES)
    for path in folder.iterdir():
        picture = imread(path)[..., :3]
        assert picture.shape[1] >= 1200, path
        drawn = np.any(np.abs(picture - 1.0) > 0.02, axis=2)
        assert 0.02 < drawn.mean() < 0.9, path
        edge = np.concatenate([drawn[:, 0], drawn[:, -1], drawn[0], drawn[-1]])
        assert not edge.any(), f"{path}: something is cut off"


def test_every_figure_of_the_papers_is_there() -> None:
    wanted = {
        "tufting": (7, 8, 9),
        "handloom_beatup": (6, 7),
        "needle_transfer": (6, 7, 8, 9),
        "elliptic_gear_beatup": (4,),
    }
    assert set(FIGURES) == {f"{machine}_figure_{number}" for machine, numbers in wanted.items() for number in numbers}


@pytest.mark.parametrize("place", ["a file", "below a file", "no folder can be made"])
def test_a_folder_that_cannot_be_written(place: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("mine")
    folder = {"a file": tmp_path / "file", "below a file": tmp_path / "file" / "figures"}.get(
        place, Path("/proc/figures")
    )
    assert main(["published", "--plots", str(folder)]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert str(folder) in said.err and said.err.startswith("textile-twin: ")
    assert (tmp_path / "file").read_text() == "mine"


def test_an_unknown_option_and_a_json_file_below_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["published", "--figures", "x"]) == 2
    (tmp_path / "file").write_text("no folder")
    assert main(["published", "--json", str(tmp_path / "file" / "f.json")]) == 2
    assert capsys.readouterr().err.count("\n") == 2
    assert (tmp_path / "file").read_text() == "no folder"
