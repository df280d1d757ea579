"""Pages against the program, without running it: quoted sentences, options, parameters, files, modules, and keys."""

from __future__ import annotations

import argparse
import ast
import dataclasses
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT, blocks, prose
from tests.docs.test_verdict_page import printed_causes
from textile_twin_core.cli.main import COMMANDS, module_of
from textile_twin_core.comparison.calibration import Ambiguity
from textile_twin_core.comparison.cause import Cause
from textile_twin_core.comparison.fault_watch import Alarm
from textile_twin_core.files.machine_file import load_machine_file as load_machine
from textile_twin_core.inference.parameter import BESIDE, ECCENTRICITY, HELD, OF_CHAIN, SENSORS
from textile_twin_core.inference.priors import WorkingPoint
from textile_twin_core.inference.priors import parameters as parameters_of
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import slots
from textile_twin_core.machines.symbolic_machine import symbolic_machine
from textile_twin_core.recordings.fault_book import Fault

SOURCES = ("textile_twin_core", "ros2_ws/src/textile_twin_ros/textile_twin_ros", "launch_scripts")
OTHER_PROGRAMS = ("apt", "faults", "import", "pip", "ros2", "sudo", "synthesize", "textile-twin", "error")
"""First words of quoted commands, and of messages of other programs."""
OTHER_OPTIONS = {
    *("--ros-args", "--params-file", "--enclave", "--log-level", "--remap", "--system-site-packages"),  # ROS, venv
    *("--system", "--now", "--no-deps", "--require-hashes", "--set-upstream"),  # useradd, systemctl, pip, git
}
NOT_RUN = {
    "it needs a PLC",
    "it needs a client",
    "it needs a ROS installation",
    "it needs Foxglove",
    "it needs the suite of the other terminal",
    "it needs a minute of the recording above",
    "it needs a fault book",
    "it needs the recordings",
    "it needs FMPy, which is in the environment of the tests alone",
    "it needs recordings of your own, and a cluster",
    "it installs a service of systemd",
    "it installs 4 GB of other libraries",
    "it installs build and twine",
    "it talks to other computers",
    "it opens a window",
    "it opens a shell with the environment",
    "it runs until it is ended",
    "it fetches sources",
    "it is what runs this page",
    "a benchmark of minutes",
}
"""Reasons for which a block may stay unrun; `PAGE runs it` is another one, and checked."""
WRITTEN = (".mapping.yaml", "metadata.yaml")
"""Ends of the names of files that `import` and rosbag2 write."""
_RUNS_IT = re.compile(r"(\S+\.md) runs it")
_NUMBER = re.compile(
    r"[:;,] |'[\w-]+'|\b(?:tufting|my_machine|causal)\b|\b(?:N m|N|ms|deg)\b|\.\.|[\w/<>'-]*[\d./_=][\w/.<>'=-]*|[+-]+"
)
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
_CODE = re.compile(r"`([^`\n]+)`")
each_page = pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=str)


def texts(tree: ast.AST) -> Iterator[str]:
    """Yield the strings of a module without its docstrings; values of f-strings are line breaks."""
    docstrings = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if node in docstrings:
            continue
        if isinstance(node, ast.JoinedStr):
            yield "".join(each.value if isinstance(each, ast.Constant) else "\n" for each in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


@pytest.fixture(scope="module", autouse=True)
def _read_once() -> None:
    """Read the program's strings before the first test."""
    program()


@cache
def program() -> str:
    """All that the program may say, in words separated by one space."""
    files = [file for folder in SOURCES for file in (ROOT / folder).rglob("*.py")]
    said = [text for file in files for text in texts(ast.parse(file.read_text(encoding="utf-8")))]
    page = [file.read_text() for file in (ROOT / "textile_twin_core" / "explore" / "page").glob("*.*")]
    scripts = [file.read_text() for file in (ROOT / "launch_scripts").glob("*.sh")]
    return re.sub(r"[ \t]+", " ", "\n".join(said + page + scripts))


def phrases(sentence: str) -> list[str]:
    """Parts of a quoted sentence between its numbers, names and paths."""
    parts = (part.strip(" .,:;()") for part in _NUMBER.split(sentence))
    return [re.sub(" +", " ", part) for part in parts if " " in part]


def quoted(page: Path) -> Iterator[str]:
    """Yield the sentences that a page quotes: output below a command, in a table of sentences, in running text."""
    if page.parent.name in ("how_to", "tutorials") or page.name in ("README.md", "field.md"):
        for block in blocks(page):
            if block.language == "text":
                yield from re.split(r" {2,}|\n", block.text)
    text = prose(page)
    for head, rows in re.findall(r"^(\| the (?:verdict|alarm) says .*\n)\|[-| :]+\n((?:\|.*\n)+)", text, re.M):
        assert head
        for row in rows.splitlines():
            yield from re.sub(r": `\w+`.*|, and the value is \w+", "", row.split(" | ")[0].strip("| ")).split("; ")
    for code in _CODE.findall(text):
        words = code.split()
        if len(words) > 1 and words[0] not in OTHER_PROGRAMS and re.fullmatch(r"[a-z][a-z ]*[\d.]*[a-z ]*:?", code):
            yield code


def is_said(phrase: str) -> bool:
    """Return true if the program has the phrase, as one piece or with a word or two at one end that it chooses."""
    if phrase in program() or phrase.replace(" ", "_") in program():
        return True
    words = phrase.split()
    cuts = [k for k in (1, 2, len(words) - 2, len(words) - 1) if len(words) > 3]
    return any(" ".join(words[:k]) in program() and " ".join(words[k:]) in program() for k in cuts)


@each_page
def test_a_quoted_sentence_is_one_of_the_program(page: Path) -> None:
    for sentence in quoted(page):
        for phrase in phrases(sentence):
            assert is_said(phrase), f"{page}: no part of the program says '{phrase}' of '{sentence}'"


@cache
def options() -> set[str]:
    """Options of all commands, scripts and benchmarks."""

    def of(parser: argparse.ArgumentParser) -> Iterator[str]:
        for action in parser._actions:
            yield from action.option_strings
            if isinstance(action, argparse._SubParsersAction):
                for task in action.choices.values():
                    yield from of(task)

    parsers = (import_module(module_of(name)).parser() for name in COMMANDS)
    scripts = [file for folder in ("launch_scripts", "tests/benchmarks") for file in (ROOT / folder).rglob("*.*")]
    theirs = {
        option for file in scripts if file.suffix in (".py", ".sh") for option in _OPTION.findall(file.read_text())
    }
    return {option for parser in parsers for option in of(parser)} | theirs


@each_page
def test_an_option_in_a_table_or_in_running_text_is_one(page: Path) -> None:
    for code in _CODE.findall(prose(page)):
        if "python -m" in code or "git " in code or "mkdocs" in code:
            continue
        for option in _OPTION.findall(code):
            assert option in options() | OTHER_OPTIONS, f"{page}: {option}"


@each_page
def test_a_limit_ends_where_its_option_says(page: Path) -> None:
    """Check words of direction: a result is over a maximum, and under a minimum."""
    for sentence in re.split(r"(?<=[.:])\s", prose(page)):
        if "--min-" in sentence:
            assert "beyond" not in sentence, f"{page}: {sentence}"


@each_page
def test_a_block_that_is_not_run_has_one_of_the_reasons(page: Path) -> None:
    for block in blocks(page):
        reason = block.marks.get("not run", "")
        runs = _RUNS_IT.fullmatch(reason)
        if runs:
            there = [each for each in blocks(Path(runs[1])) if "not run" not in each.marks]
            words = [line.split()[:2] for line in block.text.splitlines() if line.strip()]
            assert any(line.split()[:2] in words for each in there for line in each.text.splitlines()), block.place
        else:
            assert not reason or reason in NOT_RUN, f"{block.place}: '{reason}' is not in the list of reasons"


@each_page
def test_a_file_that_a_page_names_is_there_or_made_by_its_commands(page: Path) -> None:
    made = "\n".join(block.text for block in blocks(page)) + prose(page).replace("`", "") * page.is_relative_to("tests")
    names = {
        path.name
        for folder in (*SOURCES, "docs", "examples", "tests", "ros2_ws")
        for path in (ROOT / folder).rglob("*.*")
    }
    for code in _CODE.findall(prose(page)):
        if re.fullmatch(r"[\w./-]+\.(?:py|sh|xml|yaml|toml|rst|rviz|lock)", code):
            name = code.rpartition("/")[2]
            found = name in names or (ROOT / code).exists() or name in made or name.endswith(WRITTEN)
            assert found, f"{page}: {code}"


@each_page
def test_a_module_or_name_of_the_package_is_there(page: Path) -> None:
    for path in re.findall(r"(?<![\w/])textile_twin_core(?:\.\w+)+", prose(page)):
        module, rest = path, ""
        while True:
            try:
                found = import_module(module)
                break
            except ModuleNotFoundError:
                module, _, last = module.rpartition(".")
                rest = f"{last}.{rest}".strip(".")
        for name in filter(None, rest.split(".")):
            assert hasattr(found, name), f"{page}: {path}"
            found = getattr(found, name)


@each_page
def test_a_parameter_of_a_node_is_declared(page: Path) -> None:
    """Check `-p NODE:NAME:=VALUE` and `-p NAME:=VALUE`, in blocks and in running text."""
    pytest.importorskip("rclpy")
    text = (ROOT / page).read_text(encoding="utf-8")
    for node, name in re.findall(r"-p \"?'?(?:(\w+):)?(\w+):=", text):
        if name.isupper():
            continue
        known = parameters()
        nodes = [node] if node in known else list(known)
        assert any(name in known[each] for each in nodes) or name == "use_sim_time", f"{page}: {node}:{name}"


@cache
def parameters() -> dict[str, set[str]]:
    """Parameters by node."""
    found = {}
    for file in (ROOT / SOURCES[1]).glob("*_node.py"):
        named = vars(import_module(f"textile_twin_ros.{file.stem}")).items()
        declared = [each for name, each in named if name.endswith("Parameters") and dataclasses.is_dataclass(each)]
        found[file.stem] = {field.name for each in declared for field in dataclasses.fields(each)}
    return found


def keys(file: str, function: str) -> set[str]:
    """Keys of the largest object that a function builds, at its top level."""
    tree = ast.parse((ROOT / "textile_twin_core" / file).read_text())
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name == function]
    written = [each for node in nodes for each in ast.walk(node) if isinstance(each, ast.Dict)]
    largest = max(written, key=lambda each: len(each.keys))
    return {key.value for key in largest.keys if isinstance(key, ast.Constant)}


def fields(kind: type) -> set[str]:
    return {field.name for field in dataclasses.fields(kind)}


def section(page: str, heading: str) -> str:
    """Text below a heading, up to the next of its level."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return text.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]


COMMAND_KEYS = {
    "compare": lambda: keys("comparison/result.py", "to_json") | fields(Cause),
    "calibrate": lambda: keys("comparison/calibration.py", "to_json") | fields(Ambiguity),
    "identify": lambda: keys("comparison/identification.py", "to_json") | keys("comparison/file_numbers.py", "to_json"),
    "monitor": lambda: keys("cli/monitor.py", "_write") | fields(Alarm),
    "faults list": lambda: fields(Fault),
    "resonances": lambda: keys("cli/resonances.py", "_numbers") | keys("cli/resonances.py", "_mode_numbers"),
    "published": lambda: keys("cli/published_table.py", "as_json"),
}


@pytest.mark.parametrize("command", COMMAND_KEYS)
def test_every_key_that_a_command_writes_is_in_the_contract(command: str) -> None:
    documented = set(re.findall(r"`(\w+)`", section("docs/reference/json.md", command)))
    written = COMMAND_KEYS[command]()
    assert len(written) > 5
    assert documented >= written, sorted(written - documented)


def test_every_cause_has_its_value_in_the_contract() -> None:
    table = section("docs/reference/json.md", "compare").split("| cause | `value` |")[1].split("\n\n")[0]
    documented = {name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split(" | ")[0])}
    assert documented >= printed_causes(), printed_causes() - documented


def test_a_path_of_the_page_names_a_number_and_every_number_has_such_a_path() -> None:
    """Check the paths of the verdict, of tolerances and of an FMU, on a machine with loads of all kinds."""
    machine = load_machine(ROOT / "examples" / "six_bar_loom.yaml")
    assert isinstance(machine, Machine)
    declared = {slot.path for slot in slots(machine)}
    all_known = parameters_of(machine, WorkingPoint(10.0, 20.0, 0.1))[0]
    known = {parameter.name for parameter in all_known} | {ECCENTRICITY}
    beside = {
        *SENSORS,
        *BESIDE,
        HELD,
        ECCENTRICITY,
        *(parameter.name for parameter in all_known if parameter.kind in OF_CHAIN),
    }
    assert known - beside <= declared and {"loads.joint_friction.torque_Nm", "groups.l3.length_m"} <= known
    exported = symbolic_machine(machine, lambda each: [each.model.output("balancing_torque_Nm")]).parameters
    assert {path for path in exported if "[" not in path} <= declared
    page = (ROOT / "docs" / "reference" / "paths.md").read_text()
    for path in re.findall(r"`((?:points|groups|bodies|loads|measures|sensors)\.[a-z_C]\w*\.\w+)`", page):
        assert path in declared | known or "backing" in path, path


def test_a_launch_file_takes_the_arguments_of_the_page_and_no_others() -> None:
    for row in re.findall(
        r"^\| `(\w+\.launch\.py)` \| .* \| (.*) \|$", (ROOT / "docs/ros_installation.md").read_text(), re.M
    ):
        text = (ROOT / "ros2_ws/src/textile_twin_ros/launch" / row[0]).read_text()
        declared = set(re.findall(r"DeclareLaunchArgument\(\s*\"(\w+)\"", text))
        assert set(re.findall(r"`(\w+)(?::=[^`]*)?`", row[1])) == declared, row[0]


@each_page
def test_a_secured_node_is_given_its_keys_or_told_to_do_without(page: Path) -> None:
    for block in blocks(page):
        for command in re.split(r"(?<!\\)\n", block.text):
            if re.search(r"\bopcua_(?:server_)?node --ros-args", command):
                assert "certificate:=" in command or "allow_insecure:=true" in command, block.place


def test_a_page_that_a_message_names_is_there() -> None:
    for name in re.findall(r"(?:docs|launch_scripts|examples)/[\w./-]+\w", program()):
        assert (ROOT / name).exists(), name
