"""Bodies on springs and dampers between one-sided stops and elastic pads, driven by a prescribed motion.

Declare a `ContactModel`. Run it as a whole with `run_contact`, or piece by piece with a `ContactIntegrator`.
"""

from textile_twin_core.contact.drive import DrivePiece, quintic
from textile_twin_core.contact.energy import EnergyBook, book_energy
from textile_twin_core.contact.integrator import Advance, ContactIntegrator
from textile_twin_core.contact.law_pieces import law_pieces
from textile_twin_core.contact.model import FRAME, ContactModel, Pad, SlidingBody, SpringDamper, Stop
from textile_twin_core.contact.result import ContactEvent, Segment
from textile_twin_core.contact.run import ContactRun, run_contact
from textile_twin_core.contact.state import ContactState, PadState
from textile_twin_core.errors import ContactError

__all__ = [
    "FRAME",
    "Advance",
    "ContactError",
    "ContactEvent",
    "ContactIntegrator",
    "ContactModel",
    "ContactRun",
    "ContactState",
    "DrivePiece",
    "EnergyBook",
    "Pad",
    "PadState",
    "Segment",
    "SlidingBody",
    "SpringDamper",
    "Stop",
    "book_energy",
    "law_pieces",
    "quintic",
    "run_contact",
]
