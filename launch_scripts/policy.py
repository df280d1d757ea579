"""SROS2 policy for the suite of one machine: topics and services of each of its nodes."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from textile_twin_ros.machine_namespace import INPUTS, OUTPUTS, PROCESS

PROGRAM = "policy.sh"
DESCRIPTION = """\
Prints an SROS2 policy for the nodes in the namespace /NAME, which run in the enclave /NAME. On a ROS installation:
  ros2 security create_keystore keys && ros2 security create_enclave keys /NAME
  launch_scripts/policy.sh NAME > NAME.policy.xml
  ros2 security create_permission keys /NAME NAME.policy.xml"""

SHARED = ("/diagnostics", "/rosout", "/parameter_events")
PARAMETERS = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
    "get_type_description",
)
TORQUES = ("balancing_torque/measured", "balancing_torque/predicted", "balancing_torque/residual")
LIFECYCLE = ("change_state", "get_available_states", "get_available_transitions", "get_state", "get_transition_graph")


@dataclass(frozen=True)
class Rights:
    """Rights of one node beyond those of every node: topics by name in its namespace, and its own services."""

    publish: Sequence[str] = ()
    subscribe: Sequence[str] = ()
    services: Sequence[str] = ()


RIGHTS = {
    "twin_node": Rights((*OUTPUTS, "~/transition_event"), INPUTS, ("reset", *LIFECYCLE)),
    "record_node": Rights(
        (), (*INPUTS, *OUTPUTS, *PROCESS, "twin_node/transition_event", "/diagnostics"), ("start", "stop")
    ),
    "view_node": Rights((), (*INPUTS, *OUTPUTS, "/diagnostics")),
    "monitor_node": Rights(PROCESS, INPUTS, ("learn_again",)),
    "fault_node": Rights(
        (), (*INPUTS, *OUTPUTS, *PROCESS, "twin_node/transition_event", "/diagnostics"), ("list", "acknowledge")
    ),
    "shaft_node": Rights(INPUTS),
    "plc_node": Rights(INPUTS, ("balancing_torque/predicted",)),
    "opcua_node": Rights(INPUTS, ("balancing_torque/predicted",)),
    "opcua_server_node": Rights((), ("joint_states", *TORQUES)),
}


def policy(name: str) -> str:
    """Return the policy of the machine in the namespace of this name, in the format of SROS2 (policy.xsd,
    version 0.2.0).
    """
    root = ElementTree.Element("policy", version="0.2.0")
    enclave = ElementTree.SubElement(ElementTree.SubElement(root, "enclaves"), "enclave", path=f"/{name}")
    profiles = ElementTree.SubElement(enclave, "profiles")
    for node, rights in RIGHTS.items():
        profile = ElementTree.SubElement(profiles, "profile", ns=f"/{name}", node=node)
        services = [f"~/{service}" for service in (*PARAMETERS, *rights.services)]
        _rule(profile, "service", {"reply": "ALLOW"}, services)
        _rule(profile, "topic", {"publish": "ALLOW"}, [*SHARED, *rights.publish])
        _rule(profile, "topic", {"subscribe": "ALLOW"}, ["/parameter_events", "/clock", *rights.subscribe])
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _rule(profile: ElementTree.Element, kind: str, allowed: dict[str, str], names: Sequence[str]) -> None:
    rule = ElementTree.SubElement(profile, f"{kind}s", allowed)
    for name in names:
        ElementTree.SubElement(rule, kind).text = name


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the policy."""
    parser = argparse.ArgumentParser(
        PROGRAM, description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("name", metavar="NAME", help="the machine's namespace, such as loom_3")
    name = parser.parse_args(arguments).name.strip("/")
    if not re.fullmatch(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", name, re.ASCII):
        print(f"{PROGRAM}: NAME must be a ROS namespace such as loom_3, not '{name}'", file=sys.stderr)
        return 2
    print(policy(name), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
