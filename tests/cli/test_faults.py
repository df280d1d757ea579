"""textile-twin faults and opcua: printed and written outputs, and refusals."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from tests.recordings.test_fault_book import FRICTION, NEEDLE
from textile_twin_core.cli.main import main
from textile_twin_core.files.certificates import read_certificate
from textile_twin_core.files.user_file import is_password, read_users
from textile_twin_core.recordings.fault_book import FaultBook


@pytest.fixture
def book(tmp_path: Path) -> FaultBook:
    book = FaultBook(tmp_path / "book", create=True)
    book.update("/", "tufting", [FRICTION, NEEDLE], [NEEDLE])
    book.set_recording(2, "")
    return book


def test_faults_are_listed_shown_and_acknowledged(book: FaultBook, capsys: pytest.CaptureFixture[str]) -> None:
    folder, listed = str(book.folder), book.folder.parent / "faults.json"
    assert main(["faults", folder, "list", "--json", str(listed)]) == 0
    printed = capsys.readouterr()
    first, second = printed.out.splitlines()
    assert first.startswith("   1 ") and "cleared, not acknowledged" in first and first.endswith(FRICTION.text)
    assert "stands, not acknowledged" in second and printed.err == "1 stand, 2 not acknowledged\n"
    assert [fault["kind"] for fault in json.loads(listed.read_text())["faults"]] == [FRICTION.kind, NEEDLE.kind]
    assert main(["faults", folder, "ack", "1", "--by", "anna"]) == 0
    assert main(["faults", folder, "ack", "all"]) == 0
    assert capsys.readouterr().out == "acknowledged: 1\nacknowledged: 2\n"
    assert main(["faults", folder, "show", "1"]) == 0
    shown = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert (shown["acknowledged_by"], shown["recording"], shown["machine"]) == ("anna", "to come", "tufting")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["open", "1"], "is made some seconds after the alarm"),
        (["open", "2"], "is empty"),
        (["open", "1", "2"], "give the number of one fault"),
        (["ack"], "give the number of a fault"),
        (["ack", "9"], "no fault 9; it has 2"),
    ],
)
def test_mistakes_are_one_line(
    book: FaultBook, words: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["faults", str(book.folder), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert text in line


def test_a_folder_without_a_book(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["faults", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_keys_and_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("cryptography")
    assert main(["opcua", "certificate", "twin", "--out", str(tmp_path), "--host", "loom-3"]) == 0
    assert read_certificate(tmp_path / "twin.der")[1] == "urn:loom-3:textile-twin:twin"
    assert (tmp_path / "twin.key.pem").stat().st_mode & 0o777 == 0o600
    assert main(["opcua", "certificate", "twin", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    users = tmp_path / "users.txt"
    for name, password in (("anna", "loom 7"), ("otto", "x"), ("anna", "loom 8")):
        monkeypatch.setattr("sys.stdin", io.StringIO(f"{password}\n"))
        assert main(["opcua", "user", name, "--users", str(users)]) == 0
    found = read_users(users)
    assert list(found) == ["anna", "otto"] and "loom" not in users.read_text()
    assert is_password(found, "anna", "loom 8") and not is_password(found, "anna", "loom 7")
    assert not is_password(found, "unknown", "") and users.stat().st_mode & 0o777 == 0o600
