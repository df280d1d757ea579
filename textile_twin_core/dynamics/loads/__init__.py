"""Loads: the actions on the machine beside its own inertia and weight.

A load that is listed here is known to machine files. One line per name.
"""

from textile_twin_core.dynamics.loads.backing import Backing as Backing
from textile_twin_core.dynamics.loads.damping import JointDamping as JointDamping
from textile_twin_core.dynamics.loads.damping import PointDamping as PointDamping
from textile_twin_core.dynamics.loads.force_curve import ForceCurve as ForceCurve
from textile_twin_core.dynamics.loads.joint_friction import JointFriction as JointFriction
from textile_twin_core.dynamics.loads.joint_friction import SliderFriction as SliderFriction
from textile_twin_core.dynamics.loads.load import Load as Load
from textile_twin_core.dynamics.loads.load import LoadContext as LoadContext
from textile_twin_core.dynamics.loads.periodic_table import PeriodicTable as PeriodicTable
from textile_twin_core.dynamics.loads.shaft_friction import ShaftFriction as ShaftFriction
from textile_twin_core.dynamics.loads.spring import Spring as Spring
from textile_twin_core.dynamics.loads.spring import TorsionSpring as TorsionSpring
from textile_twin_core.dynamics.loads.tables import ForceTable as ForceTable
from textile_twin_core.dynamics.loads.tables import TorqueTable as TorqueTable
