"""What the machine works against, beside its own inertia and weight.

One line a name: a load in a file of its own is known to machine files once it is listed here.
"""

from textile_twin_core.dynamics.loads.backing import Backing as Backing
from textile_twin_core.dynamics.loads.damping import JointDamping as JointDamping
from textile_twin_core.dynamics.loads.damping import PointDamping as PointDamping
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
