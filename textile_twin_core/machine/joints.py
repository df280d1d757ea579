"""Names of a machine's joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from textile_twin_core.mechanism import MAIN_SHAFT, Linkage
from textile_twin_core.mechanism.joint import Joint


def default_joint_names(linkage: Linkage) -> dict[str, str]:
    """A joint name for each link that moves on its own: the shaft's for what it turns first, else the link's."""
    names = {joint.child_link: joint.name for joint in linkage.joints if joint.kind != "fixed"}
    return names if linkage.shaft_link is None else names | {linkage.shaft_link: MAIN_SHAFT}


def named_joints(linkage: Linkage, names: Mapping[str, str]) -> tuple[Joint, ...]:
    """The joints of a linkage, called as `names` says by link."""
    return tuple(
        joint if joint.kind == "fixed" else replace(joint, name=names[joint.child_link]) for joint in linkage.joints
    )
