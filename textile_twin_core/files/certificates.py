"""Application certificates for OPC UA (OPC 10000-6, 6.2.2): made, and their application URI read."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from textile_twin_core.errors import OutputError, SceneError

if TYPE_CHECKING:
    from cryptography import x509

_KEY_BITS = 2048


def make_certificate(folder: Path, name: str, hosts: Sequence[str] = (), days: int = 1825) -> tuple[Path, Path]:
    """Make a self-signed certificate and its private key, for a client and for a server.

    Args:
        folder: takes NAME.der and NAME.key.pem, the key for its owner alone; made if need be.
        name: common name, and part of the application URI `urn:HOST:textile-twin:NAME`.
        hosts: names and addresses of the computer; default: its own name and localhost.
        days: validity.

    Returns:
        Paths of certificate and key.

    Raises:
        OutputError: a file is there already, or cannot be written.
    """
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import rsa
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    certificate_path, key_path = folder / f"{name}.der", folder / f"{name}.key.pem"
    for path in (certificate_path, key_path):
        if path.exists():
            raise OutputError(f"{path}: is there already; choose another name, or remove it")
    hosts = list(hosts) or [socket.gethostname(), "localhost", "127.0.0.1"]
    alternative = [x509.UniformResourceIdentifier(f"urn:{hosts[0]}:textile-twin:{name}"), *map(_host, hosts)]
    key = rsa.generate_private_key(public_exponent=65537, key_size=_KEY_BITS)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    used_for = dict.fromkeys(("digital_signature", "content_commitment", "key_encipherment", "data_encipherment"), True)
    used_for |= dict.fromkeys(("key_agreement", "crl_sign", "encipher_only", "decipher_only"), False)
    certificate = (
        x509.CertificateBuilder(subject, subject, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))  # clocks differ
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectAlternativeName(alternative), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.KeyUsage(key_cert_sign=True, **used_for), critical=True)  # it signs itself
        .add_extension(
            x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]), critical=False
        )
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        key_path.touch(mode=0o600, exist_ok=False)
        key_path.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
        certificate_path.write_bytes(certificate.public_bytes(Encoding.DER))
    except OSError as error:
        raise OutputError(f"{error.filename or folder}: {error.strerror or error}; choose another folder") from error
    return certificate_path, key_path


def read_certificate(path: Path) -> tuple[bytes, str]:
    """A certificate (DER or PEM) in DER, and its application URI, empty where it names none.

    Raises:
        SceneError: the file cannot be read, or is no certificate.
    """
    from cryptography import x509
    from cryptography.hazmat.primitives.serialization import Encoding

    try:
        data = path.read_bytes()
        pem = data.lstrip().startswith(b"-----BEGIN")
        certificate = x509.load_pem_x509_certificate(data) if pem else x509.load_der_x509_certificate(data)
    except OSError as error:
        raise SceneError(f"{path}: {error.strerror or error}; give the file of a certificate") from error
    except ValueError as error:
        raise SceneError(f"{path}: is no certificate ({error})") from error
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uris = names.get_values_for_type(x509.UniformResourceIdentifier)
    except x509.ExtensionNotFound:
        uris = []
    return certificate.public_bytes(Encoding.DER), uris[0] if uris else ""


def _host(name: str) -> x509.GeneralName:
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        return x509.DNSName(name)
