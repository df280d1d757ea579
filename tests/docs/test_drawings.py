"""Pictures that the program makes for the pages: one for each group and each machine, with its names."""

from __future__ import annotations

import re

import pytest

from launch_scripts.group_drawings import DECLARATIONS, examples, made
from tests.docs.pages import ROOT
from textile_twin_core.files.machine_file import GROUPS


def test_every_group_has_a_drawing_on_its_page_and_its_keys_as_names() -> None:
    assert DECLARATIONS.keys() == GROUPS.keys()
    page = (ROOT / "docs" / "reference" / "groups.md").read_text()
    for kind in GROUPS:
        picture = f"groups/{kind}.png"
        assert f"## {kind}\n" in page and f"({picture})" in page and (ROOT / "docs" / "reference" / picture).exists()


@pytest.mark.parametrize("kind", DECLARATIONS)
def test_a_group_that_is_drawn_moves(kind: str) -> None:
    machine = made(DECLARATIONS[kind][0])
    shown = {*machine.point_names, *machine.linkage.solved.links}
    row = re.search(rf"^\| `{kind}` \| (.+?) \| ", (ROOT / "docs" / "reference" / "groups.md").read_text(), re.M)
    assert row is not None
    named = {
        *(
            "at",
            "end",
            "from",
            "ground",
            "pivot",
            "tip",
            "mark",
            "coupler",
            "rocker",
            "rod",
            "slider",
            "lever",
            "block",
        ),
        *("cam", "follower", "driver", "driven", "driven_at"),
    }
    for key in re.findall(r"`(\w+)`", row[1]):
        assert key in shown or key not in named, f"{kind}: the drawing has no '{key}'"


def test_every_machine_is_in_the_gallery() -> None:
    page = (ROOT / "docs" / "gallery.md").read_text()
    for name in examples():
        assert f"(gallery/{name}.png)" in page and (ROOT / "docs" / "gallery" / f"{name}.png").exists(), name
