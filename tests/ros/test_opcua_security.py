"""OPC UA with policy Basic256Sha256 on both sides, against asyncua's own client and server; strangers are refused."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("asyncua")

from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography import x509

from tests.ros.suite import Suite
from tests.ros.test_opcua import Plc
from textile_twin_core.errors import SceneError
from textile_twin_core.files.certificates import make_certificate
from textile_twin_core.files.user_file import add_user
from textile_twin_ros.diagnostics import ERROR, WARN
from textile_twin_ros.opcua_security import (
    CertificateWatch,
    ClientSecurity,
    ClientSecurityParameters,
    ServerSecurity,
    ServerSecurityParameters,
)

MODES = {"sign": ua.MessageSecurityMode.Sign, "sign_and_encrypt": ua.MessageSecurityMode.SignAndEncrypt}


class Keys:
    """Certificates of a server, of a client that it trusts and of a stranger, and one user."""

    def __init__(self, folder: Path) -> None:
        self.trusted = folder / "trusted"
        self.server, self.server_key = make_certificate(folder, "server")
        self.client, self.client_key = make_certificate(self.trusted, "client")
        self.stranger, self.stranger_key = make_certificate(folder, "stranger")
        self.users = folder / "users.txt"
        add_user(self.users, "anna", "loom 7")

    def of_server(self) -> dict[str, str]:
        """Parameters of a server."""
        own = {"certificate": str(self.server), "private_key": str(self.server_key)}
        return own | {"trusted": str(self.trusted), "users": str(self.users)}


@pytest.fixture(scope="session")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Keys:
    return Keys(tmp_path_factory.mktemp("keys"))


async def connected(
    url: str, keys: Keys, mode: str = "sign_and_encrypt", user: str = "anna", password: str = "loom 7", **other: Path
) -> Client:
    """asyncua's own client, connected."""
    client = Client(url, timeout=20.0)
    certificate, key = other.get("certificate", keys.client), other.get("private_key", keys.client_key)
    uri = x509.load_der_x509_certificate(certificate.read_bytes()).extensions
    names = uri.get_extension_for_class(x509.SubjectAlternativeName).value
    (client.application_uri,) = names.get_values_for_type(x509.UniformResourceIdentifier)
    await client.set_security(
        SecurityPolicyBasic256Sha256, certificate, key, server_certificate=str(keys.server), mode=MODES[mode]
    )
    if user:
        client.set_user(user)
        client.set_password(password)
    await client.connect()
    return client


def served(keys: Keys, **settings: Any) -> Iterator[str]:
    """The address of a server with this security."""
    security = ServerSecurity(ServerSecurityParameters(**{**keys.of_server(), **settings}))
    server = Plc(secure=security.apply)
    yield f"opc.tcp://127.0.0.1:{server.port}"
    server.close()


@pytest.fixture(scope="module")
def secured(keys: Keys) -> Iterator[str]:
    yield from served(keys)


@pytest.mark.parametrize("mode", MODES)
def test_a_known_client_and_user_read(keys: Keys, secured: str, mode: str) -> None:
    async def read() -> float:
        async with await connected(secured, keys, mode) as client:
            assert client.security_policy.Mode == MODES[mode]
            return float(await client.get_node("ns=2;s=Load").read_value())

    assert asyncio.run(read()) == 0.0


def test_only_secured_endpoints_are_offered(secured: str) -> None:
    found = asyncio.run(Client(secured, timeout=20.0).connect_and_get_server_endpoints())
    offered = {(each.SecurityPolicyUri.rpartition("#")[2], int(each.SecurityMode)) for each in found}
    assert offered == {("Basic256Sha256", int(each)) for each in MODES.values()}
    assert {int(token.TokenType) for each in found for token in each.UserIdentityTokens} == {ua.UserTokenType.UserName}


STRANGERS: dict[str, dict[str, Any]] = {
    "wrong password": {"password": "loom 8"},
    "no such user": {"user": "otto"},
    "no user": {"user": ""},
    "wrong certificate": {"stranger": True},
}


@pytest.mark.parametrize("mode", MODES)
def test_strangers_are_refused(keys: Keys, secured: str, mode: str) -> None:
    codes = {}

    async def try_all() -> None:
        for name, words in STRANGERS.items():
            given = dict(words)
            if given.pop("stranger", False):
                given |= {"certificate": keys.stranger, "private_key": keys.stranger_key}
            with pytest.raises(ua.UaError) as refusal:
                await connected(secured, keys, mode, **given)
            codes[name] = type(refusal.value).__name__

    asyncio.run(try_all())
    assert codes["wrong password"] == codes["no such user"] == "BadUserAccessDenied"
    assert codes["wrong certificate"] == "BadCertificateUntrusted"


def test_an_expired_client_is_told_so_and_expiring_certificates_are_named(keys: Keys, tmp_path: Path) -> None:
    trusted = tmp_path / "trusted"
    expired, expired_key = make_certificate(trusted, "expired", days=0)
    soon, _ = make_certificate(trusted, "soon", days=12)
    own, own_key = make_certificate(tmp_path, "own", days=0)
    shutil.copy(keys.client, trusted)
    settings = {"certificate": str(own), "private_key": str(own_key), "trusted": str(trusted)}
    security = ServerSecurity(ServerSecurityParameters(**{**keys.of_server(), **settings}))
    found = {Path(each.kind): each for each in CertificateWatch(security.certificates).findings()}
    assert set(found) == {own, expired, soon} and found[own].level == found[expired].level == ERROR
    assert found[soon].level == WARN and "expires in 11 days" in found[soon].text
    assert "expired on" in found[own].text and str(own) in found[own].text
    client = ClientSecurityParameters(
        certificate=str(keys.client), private_key=str(keys.client_key), server_certificate=str(own)
    )
    (server,) = CertificateWatch(ClientSecurity(client).certificates).findings()
    assert Path(server.kind) == own
    for url in served(keys, trusted=str(trusted)):
        with pytest.raises(ua.uaerrors.BadCertificateTimeInvalid):
            asyncio.run(connected(url, keys, certificate=expired, private_key=expired_key))


def test_a_folder_of_certificates_that_has_gone_is_a_finding(keys: Keys, tmp_path: Path) -> None:
    """As while somebody replaces it: it ended the node."""
    trusted = tmp_path / "trusted"
    shutil.copytree(keys.trusted, trusted)
    security = ServerSecurity(ServerSecurityParameters(**{**keys.of_server(), "trusted": str(trusted)}))
    shutil.rmtree(trusted)
    (found,) = CertificateWatch(security.certificates).findings()
    assert found.level == ERROR and str(trusted) in found.text


def test_a_node_names_its_expired_certificate_at_its_start(suite: Suite, tmp_path: Path) -> None:
    own, key = make_certificate(tmp_path, "own", days=0)
    words = ("url:=opc.tcp://127.0.0.1:9", "angle:='ns=2;s=Angle'", f"certificate:={own}", f"private_key:={key}")
    node = suite.start("opcua_node", *words, f"server_certificate:={own}")
    node.wait_for_words(f"certificate {own} expired on")
    assert node.end() == 0


def test_a_user_without_encryption_is_refused(secured: str) -> None:
    client = Client(secured, timeout=20.0)
    client.set_user("anna")
    client.set_password("loom 7")
    with pytest.raises(ua.UaError):
        asyncio.run(client.connect())


def test_no_session_comes_around_the_certificate(keys: Keys, secured: str) -> None:
    """A client that leaves its certificate out of the session's request has one of its channel all the same."""

    async def connect() -> None:
        client = Client(secured, timeout=20.0)
        uri = x509.load_der_x509_certificate(keys.stranger.read_bytes()).extensions
        client.application_uri = uri.get_extension_for_class(x509.SubjectAlternativeName).value[0].value
        await client.set_security(
            SecurityPolicyBasic256Sha256, keys.stranger, keys.stranger_key, server_certificate=str(keys.server)
        )
        send = client.uaclient.session.create_session

        async def without(parameters: Any) -> Any:
            parameters.ClientCertificate = None
            return await send(parameters)

        client.uaclient.session.create_session = without
        client.set_user("anna")
        client.set_password("loom 7")
        await client.connect()

    with pytest.raises(ua.uaerrors.BadUserAccessDenied):
        asyncio.run(connect())


@pytest.mark.campaign
def test_a_bench_without_security(keys: Keys) -> None:
    async def read(url: str) -> float:
        async with Client(url, timeout=20.0) as client:
            return float(await client.get_node("ns=2;s=Load").read_value())

    open_to_all = dict.fromkeys(("certificate", "private_key", "trusted", "users"), "")
    for url in served(keys, **open_to_all, allow_insecure=True):
        assert asyncio.run(read(url)) == 0.0


@pytest.mark.parametrize("mode", MODES)
def test_our_client_reads_a_secured_plc_and_trusts_no_other(
    keys: Keys, secured: str, mode: str, tmp_path: Path
) -> None:
    password = tmp_path / "password"
    password.write_text("loom 7\n")

    async def read(timeout_s: float, **settings: Any) -> float:
        own = {"certificate": str(keys.client), "private_key": str(keys.client_key), "security": mode}
        own |= {"server_certificate": str(keys.server), "user": "anna", "password_file": str(password)}
        client = Client(secured, timeout=timeout_s)
        await ClientSecurity(ClientSecurityParameters(**{**own, **settings})).apply(client)
        async with client:
            return float(await client.get_node("ns=2;s=Load").read_value())

    assert asyncio.run(read(20.0)) == 0.0
    with pytest.raises((ua.UaError, OSError, TimeoutError)):
        asyncio.run(read(2.0, server_certificate=str(keys.stranger)))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"certificate": "", "private_key": ""}, "neither encrypted nor signed: make them with textile-twin opcua"),
        ({"private_key": ""}, "'private_key' is not set"),
        ({"private_key": "stranger_key"}, "is the key of another certificate"),
        ({"certificate": "users"}, "is no certificate"),
        ({"certificate": "nowhere.der"}, "nowhere.der: No such file"),
        ({"trusted": ""}, "folder of the certificates"),
        ({"users": ""}, "'users' is not set"),
        ({"users": "server"}, "textile-twin opcua user"),
    ],
)
def test_a_server_without_security_is_refused(keys: Keys, changes: dict[str, str], text: str) -> None:
    named = {name: str(getattr(keys, value, value)) for name, value in changes.items()}
    with pytest.raises(SceneError, match=text):
        ServerSecurity(ServerSecurityParameters(**{**keys.of_server(), **named}))


def test_a_client_without_the_servers_certificate_is_refused(keys: Keys) -> None:
    own = {"certificate": str(keys.client), "private_key": str(keys.client_key)}
    with pytest.raises(SceneError, match="any server would be trusted"):
        ClientSecurity(ClientSecurityParameters(**own))
    with pytest.raises(SceneError, match="neither encrypted nor signed"):
        ClientSecurity(ClientSecurityParameters())
    assert not ClientSecurity(ClientSecurityParameters(allow_insecure=True)).is_secure
