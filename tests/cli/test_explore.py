"""textile-twin explore as a user starts it."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from tests.campaign import more
from textile_twin_core.cli.main import main

COMMAND = str(Path(sys.executable).with_name("textile-twin"))


@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGINT, *more(signal.SIGTERM)])
def test_prints_its_address_serves_and_ends_on_a_signal(ending: signal.Signals) -> None:
    command = [COMMAND, "explore", "handloom_beatup", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:") and "token=" in address
        with pytest.raises(HTTPError) as refused:  # without a cookie jar the page is refused after the redirect
            urlopen(address)
        assert refused.value.code == 403
        process.send_signal(ending)
        assert process.wait() == 0
        assert process.stderr.read() == ""


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["spinning_jenny"], "no machine 'spinning_jenny'"),
        (["handloom_beatup", "--port", "70000"], "--port: must be a whole number from 0 to 65535, not '70000'"),
        (["handloom_beatup", "--port", "80x"], "--port: must be a whole number from 0 to 65535, not '80x'"),
        (["needle_transfer", "--recording", "bags/tufting_160rpm_synthetic"], "no torque"),
        (["tufting", "--recording", "/nowhere"], "/nowhere"),
        (["missing.yaml"], "missing.yaml"),
    ],
)
def test_mistakes_are_one_line(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explore", *arguments, "--no-browser"]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1


def test_port_in_use_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["explore", "handloom_beatup", "--port", str(port), "--no-browser"]) == 2
    assert f"port {port} cannot be used" in capsys.readouterr().err
