"""Dynamics of a linkage on one shaft: bodies, reduction to one degree of freedom, reactions and loads."""

from textile_twin_core.dynamics import loads
from textile_twin_core.dynamics.body import Body
from textile_twin_core.dynamics.loads import Backing, Load, LoadContext
from textile_twin_core.dynamics.reduction import Reduction, reduce_bodies
from textile_twin_core.dynamics.shaft_state import INPUTS, ShaftState

__all__ = ["INPUTS", "Backing", "Body", "Load", "LoadContext", "Reduction", "ShaftState", "loads", "reduce_bodies"]
