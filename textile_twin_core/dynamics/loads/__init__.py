"""What the machine works against, beside its own inertia and weight."""

from textile_twin_core.dynamics.loads.backing import Backing
from textile_twin_core.dynamics.loads.load import Load, LoadContext

__all__ = ["Backing", "Load", "LoadContext"]
