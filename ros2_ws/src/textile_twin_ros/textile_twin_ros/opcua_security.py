# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""Security of OPC UA connections: policy Basic256Sha256, certificates and users, on both sides."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from rclpy.node import Node

from textile_twin_core.errors import SceneError
from textile_twin_core.files.certificates import read_certificate
from textile_twin_core.files.user_file import is_password, read_users
from textile_twin_ros.diagnostics import ERROR, WARN
from textile_twin_ros.health import Finding
from textile_twin_ros.parameters import declare, parameter

if TYPE_CHECKING:
    from asyncua import Server
    from asyncua.client.client import Client


_SOON = timedelta(days=30)
_CERTIFICATES_S = 60.0


class ConnectionParameters(Protocol):
    """Parameters with the address of a server."""

    url: str


Connection = TypeVar("Connection", bound=ConnectionParameters)


def declare_connection(node: Node, declaration: type[Connection], example: str) -> Connection:
    """Declare the parameters of a node that speaks OPC UA, and silence asyncua's own log.

    Raises:
        SceneError: the parameter `url` is no address; the message names the example.
    """
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # the nodes report the state of the connection themselves
    settings = declare(node, declaration)
    if not settings.url.startswith("opc.tcp://"):
        raise SceneError(f"parameter 'url' is '{settings.url}': give the server's address, {example}")
    return settings


class CertificateWatch:
    """Watch over the validity of certificates.

    Args:
        files: returns the files to look at; those that are no certificate are left out.
    """

    def __init__(self, files: Callable[[], Iterable[Path]]) -> None:
        self._files = files
        self._looked_s = -math.inf
        self._findings: list[Finding] = []

    def findings(self) -> list[Finding]:
        """Return a finding for each certificate that has expired or expires within 30 days; read once a minute."""
        if time.monotonic() - self._looked_s > _CERTIFICATES_S:
            self._looked_s = time.monotonic()
            try:
                self._findings = [found for path in self._files() if (found := _validity_finding(path)) is not None]
            except OSError as error:  # as while somebody replaces the folder
                self._findings = [Finding("folder", ERROR, f"certificates {error.filename}: {error.strerror}")]
        return self._findings


def _validity_finding(path: Path) -> Finding | None:
    from cryptography import x509

    try:
        certificate = x509.load_der_x509_certificate(read_certificate(path)[0])
    except SceneError:  # no certificate, such as a private key
        return None
    now, begin, end = datetime.now(UTC), certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if begin > now:
        return Finding(f"{path}", ERROR, f"certificate {path} is not valid before {begin:%Y-%m-%d %H:%M} UTC")
    if end < now:
        text = f"certificate {path} expired on {end:%Y-%m-%d}: make another with textile-twin opcua certificate"
        return Finding(f"{path}", ERROR, text)
    if end - now < _SOON:
        return Finding(f"{path}", WARN, f"certificate {path} expires in {(end - now).days} days, on {end:%Y-%m-%d}")
    return None


@dataclass
class SecurityParameters:
    """Parameters of both nodes that speak OPC UA."""

    certificate: str = parameter("", "file of this node's certificate; textile-twin opcua certificate makes one")
    private_key: str = parameter("", "file of its private key")
    allow_insecure: bool = parameter(False, "on a bench: a connection without encryption, signature and user")


def require_security(settings: SecurityParameters) -> bool:
    """Check the keys; return whether a connection is secured.

    Raises:
        SceneError: it would not be, and `allow_insecure` is not set; or certificate and key do not belong together.
    """
    if not settings.certificate and not settings.private_key:
        if settings.allow_insecure:
            return False
        raise SceneError(
            "parameters 'certificate' and 'private_key' are not set, and a connection would be neither encrypted nor"
            " signed: make them with textile-twin opcua certificate NAME, or set allow_insecure on a bench"
        )
    for name in ("certificate", "private_key"):
        if not getattr(settings, name):
            raise SceneError(f"parameter '{name}' is not set: give both certificate and private_key")
    _check_key(Path(settings.certificate), Path(settings.private_key))
    return True


def _check_key(certificate: Path, key: Path) -> None:
    from cryptography import x509
    from cryptography.hazmat.primitives.serialization import load_der_private_key, load_pem_private_key

    public = x509.load_der_x509_certificate(read_certificate(certificate)[0]).public_key()
    try:
        data = key.read_bytes()
        load = load_pem_private_key if b"-----BEGIN" in data else load_der_private_key
        fits = load(data, password=None).public_key() == public
    except OSError as error:
        raise SceneError(f"parameter 'private_key': {key}: {error.strerror or error}") from error
    except (ValueError, TypeError) as error:
        raise SceneError(f"parameter 'private_key': {key}: is no private key without password ({error})") from error
    if not fits:
        raise SceneError(f"parameter 'private_key': {key} is the key of another certificate than {certificate}")


@dataclass
class ClientSecurityParameters(SecurityParameters):
    """Parameters of the node that connects to a server."""

    security: str = parameter(
        "sign_and_encrypt", "of the connection, with policy Basic256Sha256", choices=("sign_and_encrypt", "sign")
    )
    server_certificate: str = parameter("", "file of the server's certificate: no other server is trusted")
    user: str = parameter("", "user on the server; empty: none, as where the certificate is enough")
    password_file: str = parameter("", "file whose first line is the user's password")


class ClientSecurity:
    """Secures connections of a client.

    Raises:
        SceneError: a connection would be insecure, or a file is wrong.
    """

    def __init__(self, settings: ClientSecurityParameters) -> None:
        self._settings, self._password = settings, ""
        self.is_secure = require_security(settings)
        if self.is_secure:
            if not settings.server_certificate:
                raise SceneError("parameter 'server_certificate' is not set: without it any server would be trusted")
            read_certificate(Path(settings.server_certificate))
            self._uri = read_certificate(Path(settings.certificate))[1]
        if settings.password_file:
            try:
                self._password = Path(settings.password_file).read_text().split("\n")[0]
            except OSError as error:
                place = f"parameter 'password_file': {settings.password_file}"
                raise SceneError(f"{place}: {error.strerror or error}") from error

    def certificates(self) -> list[Path]:
        """Files of this node's certificate and the server's."""
        names = (self._settings.certificate, self._settings.server_certificate) if self.is_secure else ()
        return [Path(name) for name in names]

    async def apply(self, client: Client) -> None:
        """Set policy, certificates and user of a client that is not connected yet."""
        from asyncua import ua
        from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

        settings = self._settings
        if self.is_secure:
            encrypts = settings.security == "sign_and_encrypt"
            client.application_uri = self._uri
            await client.set_security(
                SecurityPolicyBasic256Sha256,
                Path(settings.certificate),
                Path(settings.private_key),
                server_certificate=settings.server_certificate,
                mode=ua.MessageSecurityMode.SignAndEncrypt if encrypts else ua.MessageSecurityMode.Sign,
            )
        if settings.user:
            client.set_user(settings.user)
            client.set_password(self._password)


@dataclass
class ServerSecurityParameters(SecurityParameters):
    """Parameters of the node that is a server."""

    trusted: str = parameter("", "folder of the certificates of clients that may connect (.der, .pem)")
    users: str = parameter("", "file of users and passwords; textile-twin opcua user writes it")


class ServerSecurity:
    """Secures a server: endpoints Sign and SignAndEncrypt of Basic256Sha256, known certificates and known users alone.

    Certificates and users are read at each connection: a change needs no restart.

    Raises:
        SceneError: connections would be insecure, or a file is wrong.
    """

    def __init__(self, settings: ServerSecurityParameters) -> None:
        self._settings = settings
        self.is_secure = require_security(settings)
        if self.is_secure:
            if not Path(settings.trusted).is_dir() or not settings.trusted:
                raise SceneError("parameter 'trusted': give the folder of the certificates of clients")
            if not settings.users:
                raise SceneError("parameter 'users' is not set: give the file of users, see textile-twin opcua user")
            read_users(Path(settings.users))

    def certificates(self) -> list[Path]:
        """Files of this node's certificate and of trusted clients."""
        if not self.is_secure:
            return []
        return [Path(self._settings.certificate), *sorted(Path(self._settings.trusted).iterdir())]

    async def apply(self, server: Server) -> None:
        """Set endpoints, certificate and checks of a server that is not started yet."""
        from asyncua import ua

        policies, tokens = [], []
        if self.is_secure:
            settings = self._settings
            await server.load_certificate(settings.certificate)
            await server.load_private_key(settings.private_key)
            uri = read_certificate(Path(settings.certificate))[1]
            if uri:
                await server.set_application_uri(uri)
            policies += [
                ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
                ua.SecurityPolicyType.Basic256Sha256_Sign,
            ]
            tokens.append(ua.UserNameIdentityToken)
            server.iserver.certificate_validator = self._validate
        if self._settings.allow_insecure:
            policies.append(ua.SecurityPolicyType.NoSecurity)
            tokens.append(ua.AnonymousIdentityToken)
        server.set_security_policy(policies)
        server.set_identity_tokens(tokens)
        server.iserver.user_manager = self

    def get_user(
        self, _server: Any, username: str | None = None, password: str | None = None, certificate: bytes | None = None
    ) -> Any:
        """Return the user of a session on any channel, None to refuse; asyncua asks before it activates a session.

        `certificate`: the client's, of the channel itself.
        """
        from asyncua.crypto.permission_rules import User, UserRole

        if self._settings.allow_insecure and username is None and not certificate:
            return User(UserRole.User)
        if username is None or not certificate or not self._is_trusted(certificate) or not _is_in_time(certificate):
            return None
        users = read_users(Path(self._settings.users))
        return User(UserRole.User, username) if is_password(users, username, password or "") else None

    async def _validate(self, certificate: Any, description: Any) -> None:
        """Refuse an unknown or expired certificate by its own code; asyncua calls this before it creates a session."""
        from asyncua import ua
        from asyncua.common.utils import ServiceError
        from cryptography.hazmat.primitives.serialization import Encoding

        encoded = certificate.public_bytes(Encoding.DER)
        if not self._is_trusted(encoded):
            raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)
        if not _is_in_time(encoded):
            raise ServiceError(ua.StatusCodes.BadCertificateTimeInvalid)

    def _is_trusted(self, certificate: bytes) -> bool:
        known = set()
        for path in Path(self._settings.trusted).iterdir():
            with suppress(SceneError):  # no certificate, such as a private key
                known.add(read_certificate(path)[0])
        return certificate in known


def _is_in_time(certificate: bytes) -> bool:
    from cryptography import x509

    parsed, now = x509.load_der_x509_certificate(certificate), datetime.now(UTC)
    return parsed.not_valid_before_utc <= now <= parsed.not_valid_after_utc
