"""Planar linkages as chains of groups: position and derivatives over the shaft angle, in closed form.

A group that is listed here is known to machines, machine files and URDF. One line per name.
"""

from textile_twin_core.mechanism.assembly import Closeness as Closeness
from textile_twin_core.mechanism.assembly import check_assembly as check_assembly
from textile_twin_core.mechanism.cam_follower import CamFollower as CamFollower
from textile_twin_core.mechanism.crank import Crank as Crank
from textile_twin_core.mechanism.elliptic_gear_pair import EllipticGearPair as EllipticGearPair
from textile_twin_core.mechanism.gear_pair import GearPair as GearPair
from textile_twin_core.mechanism.group import MAIN_SHAFT as MAIN_SHAFT
from textile_twin_core.mechanism.group import Closure as Closure
from textile_twin_core.mechanism.group import ContactForce as ContactForce
from textile_twin_core.mechanism.group import Group as Group
from textile_twin_core.mechanism.group import PlainGroup as PlainGroup
from textile_twin_core.mechanism.linkage import THETA as THETA
from textile_twin_core.mechanism.linkage import Linkage as Linkage
from textile_twin_core.mechanism.measure import Arc as Arc
from textile_twin_core.mechanism.measure import Displacement as Displacement
from textile_twin_core.mechanism.measure import Measure as Measure
from textile_twin_core.mechanism.measure import Travel as Travel
from textile_twin_core.mechanism.motion import LinkMotion as LinkMotion
from textile_twin_core.mechanism.motion import Motion as Motion
from textile_twin_core.mechanism.motion import PointMotion as PointMotion
from textile_twin_core.mechanism.motion import Rotation as Rotation
from textile_twin_core.mechanism.prp_dyad import Guide as Guide
from textile_twin_core.mechanism.prp_dyad import PRPDyad as PRPDyad
from textile_twin_core.mechanism.rigid_arm import RigidArm as RigidArm
from textile_twin_core.mechanism.rpp_dyad import RPPDyad as RPPDyad
from textile_twin_core.mechanism.rpr_dyad import RPRDyad as RPRDyad
from textile_twin_core.mechanism.rrp_dyad import RRPDyad as RRPDyad
from textile_twin_core.mechanism.rrr_dyad import RRRDyad as RRRDyad
