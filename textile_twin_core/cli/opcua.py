"""textile-twin opcua: certificates and users of OPC UA connections."""

from __future__ import annotations

import argparse
import getpass
import sys
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, count
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.files.certificates import make_certificate, read_certificate
from textile_twin_core.files.user_file import add_user


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "opcua",
        "certificate NAME: makes NAME.der, which the other side has to trust, and NAME.key.pem, which stays here.\n"
        "user NAME: adds a user to a file of users, or changes the password, which is asked for or read from stdin.",
        "textile-twin opcua certificate twin --out keys",
    )
    parser.add_argument("what", choices=["certificate", "user"])
    parser.add_argument("name", metavar="NAME")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="of the certificate (default: here)")
    parser.add_argument("--host", action="append", default=[], help="name or address of this computer; may be repeated")
    parser.add_argument("--days", type=count, default=1825, help="validity of the certificate (default 1825)")
    parser.add_argument("--users", type=Path, metavar="FILE", help="the file of users")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Make the certificate, or enter the user."""
    if "/" in arguments.name:
        raise UsageError(f"{arguments.name}: NAME is no path; the folder goes to --out")
    if arguments.what == "certificate":
        certificate, key = make_certificate(arguments.out or Path(), arguments.name, arguments.host, arguments.days)
        print(f"certificate {certificate}, private key {key}; application URI {read_certificate(certificate)[1]}")
        return
    if arguments.users is None:
        raise UsageError("--users FILE is missing: the file that parameter 'users' of opcua_server_node names")
    add_user(arguments.users, arguments.name, _password())
    print(f"{arguments.users}: user {arguments.name}")


def _password() -> str:
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\n")
    password = getpass.getpass("password: ")
    if getpass.getpass("once more: ") != password:
        raise UsageError("the passwords differ; nothing is changed")
    return password
