"""Options for the sensors of a recording that the machine file does not describe."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from textile_twin_core.cli.arguments import count, factor, positive
from textile_twin_core.comparison.readings import ANGLE_TURNS, radians_of
from textile_twin_core.machine import ENCODER_OPTIONS, with_encoder
from textile_twin_core.machine.sensors import Encoder
from textile_twin_core.recordings.log_units import TORQUE_UNITS, spelled, unit_factor
from textile_twin_core.recordings.machine_topics import MachineTopics

if TYPE_CHECKING:
    from textile_twin_core.machine.any_machine import SomeMachine

_TYPES = {int: count, float: positive, type(None): positive}
_UNITS = {"_rad": "RAD", "_s": "S"}


def add_sensors(parser: argparse.ArgumentParser) -> None:
    """Add the settings of the encoder, its index pulse, and the units of angle and torque."""
    group = parser.add_argument_group("sensors", "these override the machine file")
    for name, text in ENCODER_OPTIONS.items():
        end = next((end for end in _UNITS if name.endswith(end)), "")
        group.add_argument(
            f"--{name.removesuffix(end).replace('_', '-')}",
            dest=name,
            type=_TYPES[type(getattr(Encoder(), name))],
            metavar=_UNITS.get(end, "N"),
            help=text,
        )
    group.add_argument(
        "--index-topic", metavar="TOPIC", help="index pulses (std_msgs/Header), one a turn, that mark the zero"
    )
    group.add_argument(
        "--angle-unit",
        dest="angle_unit_rad",
        type=_angle_unit,
        default=1.0,
        metavar="UNIT",
        help="of the angle's topic where it does not hold radians: deg, rev, gon, or the counts of a turn",
    )
    group.add_argument(
        "--torque-unit",
        type=_torque_unit,
        default=1.0,
        metavar="UNIT",
        help="of the torque's topic where it does not hold N m: N cm, kN m, .., or N m of one unit, as for a motor's"
        " current its torque constant times the gear ratio",
    )


def _angle_unit(text: str) -> float:
    """Parse a unit of angle; return it in radians."""
    try:
        return radians_of(text)
    except ValueError:
        known = f"{', '.join(ANGLE_TURNS)}, or the counts of a turn"
        raise argparse.ArgumentTypeError(f"must be {known}, not '{text}'") from None


def _torque_unit(text: str) -> float:
    """Parse a unit of torque; return it in N m."""
    known = unit_factor(spelled(text), TORQUE_UNITS)
    if known is not None:
        return known
    try:
        float(text)
    except ValueError:
        words = ", ".join(TORQUE_UNITS)
        raise argparse.ArgumentTypeError(f"must be {words}, or N m of one unit, not '{text}'") from None
    return factor(text)


def with_sensors(machine: SomeMachine, arguments: argparse.Namespace) -> SomeMachine:
    """Return the machine with the encoder of the arguments. Raises MachineError."""
    given = {name: getattr(arguments, name) for name in ENCODER_OPTIONS}
    return with_encoder(machine, {name: value for name, value in given.items() if value is not None})


def topics_of(arguments: argparse.Namespace) -> MachineTopics:
    """Return the topics and units of angle and torque, by add_recording_topics and add_sensors."""
    return MachineTopics(
        arguments.angle_topic,
        arguments.torque_topic,
        arguments.joint,
        arguments.index_topic,
        arguments.angle_unit_rad,
        arguments.torque_unit,
        arguments.skip_bad_samples,
    )
