"""Machines: declarations of linkages and contact machines, their outputs, sensors and robot description."""

from textile_twin_core.machine.any_machine import AnyMachine as AnyMachine
from textile_twin_core.machine.any_machine import with_encoder as with_encoder
from textile_twin_core.machine.contact_machine import ContactMachine as ContactMachine
from textile_twin_core.machine.contact_machine import DrivenElement as DrivenElement
from textile_twin_core.machine.events import Event as Event
from textile_twin_core.machine.machine import Machine as Machine
from textile_twin_core.machine.main_shaft import EvenShaft as EvenShaft
from textile_twin_core.machine.main_shaft import MainShaft as MainShaft
from textile_twin_core.machine.main_shaft import ShaftDrive as ShaftDrive
from textile_twin_core.machine.main_shaft import ShaftPiece as ShaftPiece
from textile_twin_core.machine.main_shaft import ShaftPlace as ShaftPlace
from textile_twin_core.machine.main_shaft import Station as Station
from textile_twin_core.machine.sensors import ENCODER_OPTIONS as ENCODER_OPTIONS
from textile_twin_core.machine.sensors import Encoder as Encoder
from textile_twin_core.machine.sensors import Scene as Scene
from textile_twin_core.machine.sensors import Sensors as Sensors
from textile_twin_core.machine.sensors import TorqueSensor as TorqueSensor
from textile_twin_core.machine.torque_filter import FilterSession as FilterSession
from textile_twin_core.machine.torque_filter import TorqueFilter as TorqueFilter
