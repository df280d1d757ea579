"""What README tells the reader to run is there and runs."""

from __future__ import annotations

import importlib.util
import os
import re
from pathlib import Path

import pytest

from textile_twin_core.cli.main import main

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
WITH_TASKS = ("synthesize",)
COMMANDS = sorted(set(re.findall(r"textile-twin ([a-z]+)([^\n`]*)", README)))


def test_its_python_runs_as_printed() -> None:
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(block, "README.md", "exec"), names)
    assert len(names["samples"]) == 998  # type: ignore[arg-type]


@pytest.mark.parametrize(("command", "rest"), COMMANDS)
def test_its_commands_and_options_are_there(command: str, rest: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main([command, *([rest.split()[0]] if command in WITH_TASKS and rest.split() else []), "--help"])
    assert stop.value.code == 0
    told = capsys.readouterr().out
    for option in re.findall(r"--[a-z-]+", rest):
        assert option == "--help" or option in told, option


def test_its_scripts_can_be_started() -> None:
    for script in set(re.findall(r"launch_scripts/\w+\.sh", README)):
        assert os.access(ROOT / script, os.X_OK), script
    for script in (ROOT / "launch_scripts").glob("*.sh"):
        assert os.access(script, os.X_OK) == script.read_text().startswith("#!"), script


def test_what_it_points_to_is_there() -> None:
    for path in re.findall(r"(?:docs|examples|ros2_ws|bags|tests)/[\w./-]*\w", README):
        assert (ROOT / path).exists(), path
    for module in re.findall(r"python -m ([\w.]+)", README):
        assert importlib.util.find_spec(module) is not None, module
