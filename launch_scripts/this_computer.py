"""Environment that restricts nodes to this computer: they communicate over its loopback interface only."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Variables with the settings of Fast DDS 2 and 3; nodes with Fast DDS 3 warn about the first one."""


def this_computer_alone() -> dict[str, str]:
    """Return the environment in which nodes communicate on this computer, unaffected by leftovers of killed nodes.

    The discovery range LOCALHOST would make Fast DDS use shared memory in spite of its settings. SYSTEM_DEFAULT applies
    these settings, and SUBNET is for other computers.
    """
    settings = str(Path(__file__).with_name("this_computer.xml"))
    has_second = any((Path(sys.prefix) / "lib").glob("libfastrtps.so*"))  # version 3 is named libfastdds
    return {RANGE: "SYSTEM_DEFAULT", _PROFILES[0 if has_second else 1]: settings}


def asked_for(environment: Mapping[str, str]) -> bool:
    """Return true if nodes are to stay on this computer: no discovery range or Fast DDS settings are given."""
    return environment.get(RANGE, "LOCALHOST") == "LOCALHOST" and not environment.keys() & set(_PROFILES)
