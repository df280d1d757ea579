"""Users and their passwords in a file: one line each, NAME:SALT:HASH, the hash by scrypt (RFC 7914)."""

from __future__ import annotations

import hashlib
import hmac
import os
from pathlib import Path

from textile_twin_core.errors import OutputError, SceneError
from textile_twin_core.files.atomic import staged

_COST = {"n": 2**14, "r": 8, "p": 1}
_UNKNOWN = ("00" * 16, "00" * 64)
"""Salt and hash checked for an unknown user, so that the answer takes as long."""


def read_users(path: Path) -> dict[str, tuple[str, str]]:
    """Read salt and hash of each user by name.

    Raises:
        SceneError: the file cannot be read, or a line is not written so.
    """
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: cannot be read ({error}); make it with textile-twin opcua user") from error
    users = {}
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        parts = line.strip().split(":")
        if len(parts) != 3 or not parts[0]:
            raise SceneError(f"{path}, line {number}: is not NAME:SALT:HASH; make it with textile-twin opcua user")
        users[parts[0]] = (parts[1], parts[2])
    return users


def add_user(path: Path, name: str, password: str) -> None:
    """Add a user, or give one another password; the file is for its owner alone.

    Raises:
        SceneError: the name or the password cannot be one, or the file does not hold users.
        OutputError: the file cannot be written.
    """
    if not name or ":" in name or name.startswith("#") or not name.isprintable():
        raise SceneError(f"user '{name}': choose a name without colon")
    if not password:
        raise SceneError(f"user '{name}': the password is empty")
    users = read_users(path) if path.exists() else {}
    salt = os.urandom(16).hex()
    users[name] = (salt, _hash(password, salt))
    try:
        with staged(path) as partial:
            partial.touch(mode=0o600)
            partial.write_text("".join(f"{user}:{salt}:{digest}\n" for user, (salt, digest) in users.items()))
    except OSError as error:
        raise OutputError(f"{path}: {error.strerror or error}") from error


def is_password(users: dict[str, tuple[str, str]], name: str, password: str) -> bool:
    """Check a user's password."""
    salt, digest = users.get(name, _UNKNOWN)
    return hmac.compare_digest(_hash(password, salt), digest) and name in users


def _hash(password: str, salt: str) -> str:
    return hashlib.scrypt(password.encode(), salt=bytes.fromhex(salt), **_COST).hex()
