"""Declaration of an elastic main shaft: stations with discs, pieces between them, sensors and drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from itertools import pairwise

from textile_twin_core.errors import MachineError
from textile_twin_core.mechanism.group import check_finite

STEEL_SHEAR_MODULUS_PA = 7.9e10
STEEL_DENSITY_KG_M3 = 7850.0


def _check_not_negative(what: str, **values: float) -> None:
    for key, value in values.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise MachineError(f"{what}: {key} must be zero or positive, not {value!r}")


@dataclass(frozen=True)
class ShaftPlace:
    """Position of one linkage on the shaft.

    Attributes:
        phase_rad: lead of the linkage's crank over the shaft angle [rad].
        at: station of an elastic shaft that carries the linkage; None on a rigid shaft.
    """

    phase_rad: float = 0.0
    at: str | None = None

    def __post_init__(self) -> None:
        check_finite(self.phase_rad, "linkages: phase_rad")


@dataclass(frozen=True)
class Station:
    """Disc on the shaft.

    Attributes:
        name: name of the station.
        inertia_kgm2: inertia of the disc itself [kg m^2].
        viscous_Nms: viscous friction of its bearing [N m s].
    """

    name: str
    inertia_kgm2: float = 0.0
    viscous_Nms: float = 0.0

    def __post_init__(self) -> None:
        _check_not_negative(f"station '{self.name}'", inertia_kgm2=self.inertia_kgm2, viscous_Nms=self.viscous_Nms)


@dataclass(frozen=True)
class ShaftPiece:
    """Elastic piece of shaft between two neighbouring stations, behind an optional gear.

    Give `stiffness_Nm_rad`, or `diameter_m` and `length_m` of a round bar, whose inertia is split between its ends.

    Attributes:
        gear_ratio: speed of the station `from_station` over that of `to_station`. The gear is in front of the piece, so
            stiffness, damping, backlash and torque refer to the side of `to_station`.
        backlash_rad: full play [rad], a dead band in which the piece carries no torque.
    """

    from_station: str
    to_station: str
    stiffness_Nm_rad: float | None = None
    damping_Nms_rad: float = 0.0
    diameter_m: float | None = None
    length_m: float | None = None
    shear_modulus_Pa: float = STEEL_SHEAR_MODULUS_PA
    density_kg_m3: float = STEEL_DENSITY_KG_M3
    gear_ratio: float = 1.0
    backlash_rad: float = 0.0

    def __post_init__(self) -> None:
        what = f"piece from '{self.from_station}' to '{self.to_station}'"
        bar = (self.diameter_m, self.length_m)
        if (self.stiffness_Nm_rad is None and None in bar) or (
            self.stiffness_Nm_rad is not None and bar != (None, None)
        ):
            raise MachineError(f"{what}: give either stiffness_Nm_rad, or both diameter_m and length_m of a bar")
        for key in ("stiffness_Nm_rad", "diameter_m", "length_m", "shear_modulus_Pa"):
            value = getattr(self, key)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise MachineError(f"{what}: {key} must be positive, not {value!r}")
        if not (math.isfinite(self.gear_ratio) and self.gear_ratio != 0.0):
            raise MachineError(f"{what}: gear_ratio must be a finite number other than zero, not {self.gear_ratio!r}")
        _check_not_negative(
            what,
            damping_Nms_rad=self.damping_Nms_rad,
            density_kg_m3=self.density_kg_m3,
            backlash_rad=self.backlash_rad,
        )

    @property
    def stiffness(self) -> float:
        """Torque per twist [N m/rad], as given or G pi d^4 / (32 L) of the bar."""
        if self.stiffness_Nm_rad is not None:
            return self.stiffness_Nm_rad
        return self.shear_modulus_Pa * self._second_moment_m4 / (self.length_m or math.inf)

    @property
    def bar_inertia_kgm2(self) -> float:
        """Inertia of the bar about its axis [kg m^2]; 0 if the stiffness is given."""
        if self.stiffness_Nm_rad is not None:
            return 0.0
        return self.density_kg_m3 * self._second_moment_m4 * (self.length_m or 0.0)

    @property
    def _second_moment_m4(self) -> float:
        return math.pi * (self.diameter_m or 0.0) ** 4 / 32.0


@dataclass(frozen=True)
class ShaftDrive:
    """Drive of the shaft: its station, its inertia beside the station's, and its slip.

    The drive torque decreases by `slip_Nms_rad` per rad/s of speed at `at` (by default the first station). A value of
    None is unknown and can be identified.
    """

    at: str | None = None
    inertia_kgm2: float | None = None
    slip_Nms_rad: float | None = None

    def __post_init__(self) -> None:
        _check_not_negative("drive", inertia_kgm2=self.inertia_kgm2 or 0.0, slip_Nms_rad=self.slip_Nms_rad or 0.0)


@dataclass(frozen=True)
class MainShaft:
    """Elastic main shaft: a chain of stations joined by pieces, in order.

    Attributes:
        stations: at least two discs.
        pieces: elastic pieces between neighbouring stations.
        encoder_at: station of the encoder; the first by default.
        second_encoder_at: station of a second encoder, or None.
        torque_sensor: the two ends of the measured piece, positive if it drives the second end; the first piece by
            default.
        drive: the drive, at the first station by default.

    Raises:
        MachineError: for stations and pieces that form no chain.

    Examples:
        >>> ends = Station("motor", 0.5), Station("head", 0.01)
        >>> shaft = MainShaft(ends, (ShaftPiece("motor", "head", stiffness_Nm_rad=4.0e4),))
        >>> shaft.torque_piece
        (0, 1)
    """

    stations: tuple[Station, ...]
    pieces: tuple[ShaftPiece, ...]
    encoder_at: str | None = None
    second_encoder_at: str | None = None
    torque_sensor: tuple[str, str] | None = None
    drive: ShaftDrive = ShaftDrive()

    def __post_init__(self) -> None:
        for part in ("stations", "pieces"):
            object.__setattr__(self, part, tuple(getattr(self, part)))
        if len(self.stations) < 2:
            raise MachineError("stations: an elastic shaft has two or more; leave the shaft out where it is rigid")
        for k, station in enumerate(self.stations):
            if station.name in self.names[:k]:
                raise MachineError(f"stations[{k}].name: there is another station '{station.name}'; rename one")
        for k, piece in enumerate(self.pieces):
            self.station(piece.from_station, f"pieces[{k}].from")
            self.station(piece.to_station, f"pieces[{k}].to")
            ends = (piece.from_station, piece.to_station)
            if k + 1 >= len(self.names) or ends != (self.names[k], self.names[k + 1]):
                due = (
                    f"from '{self.names[k]}' to '{self.names[k + 1]}'" if k + 1 < len(self.names) else "no piece at all"
                )
                raise MachineError(
                    f"pieces[{k}]: joins '{ends[0]}' and '{ends[1]}', but a shaft is a chain in the order of its "
                    f"stations: here stands {due}"
                )
        if len(self.pieces) < len(self.stations) - 1:
            k = len(self.pieces)
            raise MachineError(f"pieces: the one from '{self.names[k]}' to '{self.names[k + 1]}' is missing")
        self.station(self.encoder_at, "encoder_at")
        if self.second_encoder_station == self.encoder_station:
            raise MachineError(
                f"second_encoder_at: station '{self.second_encoder_at}' has the first encoder already; name another one"
            )
        self.station(self.drive.at, "drive.at")
        _ = self.torque_piece

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the stations in order."""
        return tuple(station.name for station in self.stations)

    def station(self, name: str | None, place: str) -> int:
        """Return the number of a station; the first for None. Raises MachineError for an unknown one."""
        if name is None:
            return 0
        if name not in self.names:
            near = get_close_matches(name, self.names, n=2, cutoff=0.5) or self.names[:6]
            raise MachineError(f"{place}: there is no station '{name}'; did you mean {' or '.join(near)}?")
        return self.names.index(name)

    @property
    def encoder_station(self) -> int:
        """Number of the station measured by the encoder."""
        return self.station(self.encoder_at, "encoder_at")

    @property
    def second_encoder_station(self) -> int | None:
        """Number of the second encoder's station, None without one."""
        return None if self.second_encoder_at is None else self.station(self.second_encoder_at, "second_encoder_at")

    @property
    def drive_station(self) -> int:
        """Number of the station on which the drive acts."""
        return self.station(self.drive.at, "drive.at")

    @property
    def torque_piece(self) -> tuple[int, int]:
        """Number of the piece measured by the torque sensor, and its sign: -1 for ends named backwards."""
        if self.torque_sensor is None:
            return 0, 1
        low, high = (self.station(name, f"torque_sensor[{k}]") for k, name in enumerate(self.torque_sensor))
        if abs(high - low) != 1:
            raise MachineError(
                f"torque_sensor: '{self.names[low]}' and '{self.names[high]}' are not the two ends of one piece"
            )
        return min(low, high), high - low

    @cached_property
    def speed_ratios(self) -> tuple[float, ...]:
        """Speed of each station over that of the first, from the gears between them."""
        ratios = [1.0]
        for piece in self.pieces:
            ratios.append(ratios[-1] / piece.gear_ratio)
        return tuple(ratios)


@dataclass(frozen=True)
class EvenShaft:
    """Short form of a shaft: a round bar in equal pieces, from its driven end s0 to the last of its stations.

    The linkages are on s1, s2, ..; s0 carries none.

    Attributes:
        diameter_m, length_m: of the bar [m].
        stations: number of pieces.
        shear_modulus_Pa: of its material [Pa].
        density_kg_m3: of its material [kg/m^3]; 0 leaves its own inertia out.
        damping_Nms_rad: of the whole length, end to end [N m s/rad]; divided as for dampers in series.
        encoder_at, second_encoder_at: stations of the encoders.
        torque_sensor: ends of the piece whose torque the sensor shows.
        drive: the drive.

    Examples:
        >>> shaft = EvenShaft(diameter_m=0.06, length_m=4.0, stations=16).main_shaft()
        >>> len(shaft.stations), round(shaft.pieces[0].stiffness / 16)
        (17, 25129)
    """

    diameter_m: float
    length_m: float
    stations: int
    shear_modulus_Pa: float = STEEL_SHEAR_MODULUS_PA
    density_kg_m3: float = STEEL_DENSITY_KG_M3
    damping_Nms_rad: float = 0.0
    encoder_at: str | None = None
    second_encoder_at: str | None = None
    torque_sensor: tuple[str, str] | None = None
    drive: ShaftDrive = ShaftDrive()

    def __post_init__(self) -> None:
        if self.stations < 1:
            raise MachineError(f"stations: must be 1 or more, not {self.stations}")

    def main_shaft(self) -> MainShaft:
        """Build the shaft with every station and piece."""
        count = self.stations
        names = [f"s{k}" for k in range(count + 1)]
        bar = ShaftPiece(
            names[0],
            names[1],
            diameter_m=self.diameter_m,
            length_m=self.length_m / count,
            damping_Nms_rad=self.damping_Nms_rad * count,
            shear_modulus_Pa=self.shear_modulus_Pa,
            density_kg_m3=self.density_kg_m3,
        )
        return MainShaft(
            tuple(Station(name) for name in names),
            tuple(replace(bar, from_station=a, to_station=b) for a, b in pairwise(names)),
            self.encoder_at,
            self.second_encoder_at,
            self.torque_sensor,
            self.drive,
        )

    def places(self, linkages: Sequence[ShaftPlace] = ()) -> tuple[ShaftPlace, ...]:
        """Distribute the linkages evenly over the stations, one per station if none are given; given stations stay."""
        spread = linkages or (ShaftPlace(),) * self.stations
        share = self.stations / len(spread)
        return tuple(
            replace(place, at=f"s{1 + int((k + 0.5) * share)}") if place.at is None else place
            for k, place in enumerate(spread)
        )
