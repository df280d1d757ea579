"""The SROS2 policy that policy.sh prints, compared with what the nodes publish, hear and offer."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("rclpy")

from tests.ros.suite import Suite

ROOT = Path(__file__).parents[2]
SPACE = "/loom_3"


def printed(name: str) -> subprocess.CompletedProcess[str]:
    """Output of policy.sh."""
    command = [str(ROOT / "launch_scripts" / "policy.sh"), name]
    return subprocess.run(command, capture_output=True, text=True)


def allowed(root: ElementTree.Element, node: str, kind: str, right: str) -> set[str]:
    """Full names of topics or services that a node has this right to."""
    places = {"/": "", "~": f"{SPACE}/{node}"}
    names = [
        entry.text or ""
        for rule in root.findall(f"enclaves/enclave/profiles/profile[@node='{node}']/{kind}s[@{right}='ALLOW']")
        for entry in rule.findall(kind)
    ]
    return {places.get(name[0], f"{SPACE}/") + name.lstrip("~") for name in names}


@pytest.mark.campaign
@pytest.mark.slow
def test_the_policy_allows_what_the_nodes_do_and_no_more(suite: Suite) -> None:
    made = printed("loom_3")
    assert made.returncode == 0, made.stderr
    root = ElementTree.fromstring(made.stdout)
    assert [enclave.get("path") for enclave in root.iter("enclave")] == [SPACE]
    assert {profile.get("ns") for profile in root.iter("profile")} == {SPACE}
    nodes = ("twin_node", "record_node", "view_node", "monitor_node", "shaft_node")
    for node in nodes:
        settings = {
            "record_node": [f"bag:={suite.folder / 'bag'}"],
            "view_node": ["port:=0", f"file:={suite.folder / 'v.rrd'}"],
        }
        suite.start(node, *settings.get(node, []), remaps=[f"__ns:={SPACE}"])
    watcher = suite.node()
    kinds: list[tuple[str, str, Callable[[str, str], list[tuple[str, list[str]]]]]] = [
        ("topic", "publish", watcher.get_publisher_names_and_types_by_node),
        ("topic", "subscribe", watcher.get_subscriber_names_and_types_by_node),
        ("service", "reply", watcher.get_service_names_and_types_by_node),
    ]

    def seen(node: str) -> list[set[str]]:
        there = dict(watcher.get_node_names_and_namespaces())
        return [{name for name, _ in find(node, SPACE)} if node in there else set() for _, _, find in kinds]

    def offers_all(node: str) -> bool:
        """All services that are allowed; of topics those of other machines' measures are allowed, too."""
        return allowed(root, node, "service", "reply") - {f"{SPACE}/{node}/get_type_description"} <= seen(node)[2]

    # The recorder hears a topic once it has found it.
    suite.spin_until(
        lambda: (
            all(seen(node)[0] and offers_all(node) for node in nodes)
            and f"{SPACE}/joint_states" in seen("record_node")[1]
        ),
        "all nodes with all they have",
    )
    suite.spin_for(1.0)
    for node in nodes:
        for (kind, right, _), names in zip(kinds, seen(node), strict=True):
            surplus = names - allowed(root, node, kind, right)
            assert not surplus, f"{node} may not {right} {surplus}"


@pytest.mark.parametrize("name", ["loom-3", "", "3"])
def test_a_name_that_is_no_namespace(name: str) -> None:
    made = printed(name)
    assert (made.returncode, made.stdout) == (2, "")
    assert made.stderr.splitlines() == [f"policy.sh: NAME must be a ROS namespace such as loom_3, not '{name}'"]


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
        "ROS_SECURITY_ENCLAVE_OVERRIDE": SPACE,
    }
    program = suite.start("shaft_node")
    assert program.wait() == 2
    assert "Traceback" not in program.words()
    assert program.words().splitlines()[-1].startswith("shaft_node: ")
