"""Keeps nodes to this computer: the environment in which they hear each other over its loopback interface alone."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Where Fast DDS 2 and 3 find their settings; each node of ROS with Fast DDS 3 complains of the first."""


def this_computer_alone() -> dict[str, str]:
    """The environment in which nodes hear each other on this computer, and what a killed one leaves disturbs none.

    The discovery range LOCALHOST itself would have Fast DDS use shared memory, whatever its settings say;
    SYSTEM_DEFAULT leaves it to these settings, SUBNET is for other computers.
    """
    settings = str(Path(__file__).with_name("this_computer.xml"))
    has_second = any((Path(sys.prefix) / "lib").glob("libfastrtps.so*"))  # the third is libfastdds
    return {RANGE: "SYSTEM_DEFAULT", _PROFILES[0 if has_second else 1]: settings}


def asked_for(environment: Mapping[str, str]) -> bool:
    """Whether nodes are to keep to this computer: unless a range or settings of Fast DDS say otherwise."""
    return environment.get(RANGE, "LOCALHOST") == "LOCALHOST" and not environment.keys() & set(_PROFILES)
