"""Planar linkages as chains of groups: position and derivatives over the shaft angle, in closed form."""

from textile_twin_core.mechanism.assembly import Closeness, check_assembly
from textile_twin_core.mechanism.crank import Crank
from textile_twin_core.mechanism.elliptic_gear_pair import EllipticGearPair
from textile_twin_core.mechanism.group import MAIN_SHAFT, Closure, Group
from textile_twin_core.mechanism.linkage import THETA, Linkage
from textile_twin_core.mechanism.measure import Arc, Displacement, Measure, Travel
from textile_twin_core.mechanism.motion import LinkMotion, Motion, PointMotion, Rotation
from textile_twin_core.mechanism.rigid_arm import RigidArm
from textile_twin_core.mechanism.rrp_dyad import RRPDyad
from textile_twin_core.mechanism.rrr_dyad import RRRDyad

__all__ = [
    "MAIN_SHAFT",
    "THETA",
    "Arc",
    "Closeness",
    "Closure",
    "Crank",
    "Displacement",
    "EllipticGearPair",
    "Group",
    "LinkMotion",
    "Linkage",
    "Measure",
    "Motion",
    "PointMotion",
    "RRPDyad",
    "RRRDyad",
    "RigidArm",
    "Rotation",
    "Travel",
    "check_assembly",
]
