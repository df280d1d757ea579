"""What the machine works against, beside its own inertia and weight."""

from textile_twin_core.dynamics.loads.backing import Backing
from textile_twin_core.dynamics.loads.damping import JointDamping, PointDamping
from textile_twin_core.dynamics.loads.joint_friction import JointFriction, SliderFriction
from textile_twin_core.dynamics.loads.load import Load, LoadContext
from textile_twin_core.dynamics.loads.periodic_table import PeriodicTable
from textile_twin_core.dynamics.loads.shaft_friction import ShaftFriction
from textile_twin_core.dynamics.loads.spring import Spring, TorsionSpring
from textile_twin_core.dynamics.loads.tables import ForceTable, TorqueTable

__all__ = [
    "Backing",
    "ForceTable",
    "JointDamping",
    "JointFriction",
    "Load",
    "LoadContext",
    "PeriodicTable",
    "PointDamping",
    "ShaftFriction",
    "SliderFriction",
    "Spring",
    "TorqueTable",
    "TorsionSpring",
]
