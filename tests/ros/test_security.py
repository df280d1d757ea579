"""Security that this middleware does not have ends a node; it never runs unencrypted."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from tests.ros.suite import Suite


def test_security_that_the_middleware_does_not_have_is_reported_in_a_line(suite: Suite) -> None:
    enclave = suite.folder / "keys" / "enclaves" / "loom_3"
    enclave.mkdir(parents=True)
    for name in ("identity_ca.cert", "cert", "key", "permissions_ca.cert"):
        (enclave / f"{name}.pem").touch()
    for name in ("governance", "permissions"):
        (enclave / f"{name}.p7s").touch()
    suite.environment |= {
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(suite.folder / "keys"),
        "ROS_SECURITY_ENCLAVE_OVERRIDE": "/loom_3",
    }
    program = suite.start("shaft_node")
    assert program.wait() == 2
    assert "Traceback" not in program.words()
    assert program.words().splitlines()[-1].startswith("shaft_node: ")
