"""Balancing of a machine by counterweights, springs, linkages out of phase and flywheels, before and after."""

from textile_twin_core.synthesis.balancing.counterweight import Counterweight, Counterweighted, counterweights
from textile_twin_core.synthesis.balancing.flywheel import Flywheel, flywheel
from textile_twin_core.synthesis.balancing.phase import Phased, opposed_linkages
from textile_twin_core.synthesis.balancing.shaking import Shaking, shaking
from textile_twin_core.synthesis.balancing.spring import Sprung, balancing_spring

WAYS = ("counterweight", "force", "spring", "second-linkage", "flywheel")
"""Methods of balancing, by the names used on the command line."""

__all__ = [
    "WAYS",
    "Counterweight",
    "Counterweighted",
    "Flywheel",
    "Phased",
    "Shaking",
    "Sprung",
    "balancing_spring",
    "counterweights",
    "flywheel",
    "opposed_linkages",
    "shaking",
]
