"""Observer of an elastic shaft: readings of one encoder or two in, motion of all stations and torques of pieces out.

An `ElasticPredictor` owns one observer, for live samples and for recordings, in one thread. docs/driveline.md has
accuracy and cost of a sample. tests/twin/test_elastic_session.py and test_second_encoder.py compare it with independent
integrations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import records
from textile_twin_core.driveline.chain import ElasticShaft, ShaftChain
from textile_twin_core.driveline.drive_bank import MEMORIES, drive_bank
from textile_twin_core.driveline.observer_step import (
    FIRST_DRIVE,
    FOLLOWING,
    LEAD,
    OBSERVER,
    STATE,
    Room,
    ShaftReadings,
    observe_readings,
)
from textile_twin_core.driveline.runs import Outputs, follow, outputs
from textile_twin_core.driveline.second_encoder import assembled, hold_zero, second_encoder
from textile_twin_core.driveline.step import chain_state

_STABLE = 0.9
"""Share of a station's inertia that the correction of the natural frequencies may take."""
_FREQUENCY_ERROR = 5e-4
"""Relative error of the first natural frequency that the time step may leave."""
_MOBILITY_SIGMA = 0.3
"""Prior standard deviation of beta = 1 / (all inertia), over its largest possible value: any drive inertia."""
_SLIP_SIGMA = 100.0
"""Prior standard deviation of lambda = slip * beta [1/s]: any drive from open loop to a stiff speed loop."""
_WAIT_PERIODS = 10.0
"""Periods of the first mode after which an unknown drive is estimated."""
_RINGING = math.log(100.0)
"""Decay of the vibration that a start leaves, until a prediction is settled."""
_SWEEP, _SWEEP_S, _SAMPLE_S = (0.5, 3.0), 3.0, 1e-3
"""Speeds over the nominal one, duration and sampling of the sweep in which the error of the time step is measured."""
_FINER = 4
"""Factor on the substeps in the reference run of that sweep."""


@dataclass(frozen=True)
class Observed:
    """Result of the observer for n readings.

    found: (n,) records of STATE. motion: psi, omega, alpha (n, stations) and pieces (n, pieces), reduced to the main
    shaft.
    """

    found: npt.NDArray[Any]
    motion: Outputs


@dataclass(frozen=True)
class ObserverScales:
    """Times and errors of an observer that follow from its machine.

    first_mode_rad_s, damping_ratio: of the first natural mode with the mean inertias; pieces, bearings and the slip of
    a known drive damp it. substep_s: time step.
    numeric_error: root mean square error of the sensor's torque that the step leaves, over the root mean square torque.
    """

    first_mode_rad_s: float
    damping_ratio: float
    substep_s: float
    numeric_error: float


class ShaftObserver:
    """Observer of an elastic shaft.

    The chain is the process model, with the drive's disc free. Corrections shift all stations alike. A bank of Kalman
    filters (`drive_bank`) estimates them, the drive's torque, and inertia and slip where the machine leaves them out.
    A second encoder corrects the twist (`second_encoder`); while it is silent, its filters predict the correction.
    After a gap, and where the track is lost, the chain restarts from the shaft estimator's motion.

    Args:
        elastic: The shaft, from `elastic_shaft`.
        nominal_speed_rad_s: Speed at which the step's error is measured.
        scales: Times and errors to take over from a similar shaft; computed unless given.
        memories: Samples over which each filter of the bank takes the drive torque for constant.
        second_period_rad: Angle after which readings of the second encoder may repeat, reduced to the main shaft.
    """

    def __init__(
        self,
        elastic: ElasticShaft,
        nominal_speed_rad_s: float,
        scales: ObserverScales | None = None,
        memories: FloatArray = MEMORIES,
        second_period_rad: float = math.tau,
    ) -> None:
        self._second_period = abs(second_period_rad)
        self.elastic, self._speed, self._given, self._memories = elastic, nominal_speed_rad_s, scales, memories
        shaft = elastic.shaft
        drive, self._gear = shaft.drive_station, elastic.ratios[shaft.drive_station] ** 2
        self._inertia = elastic.mean_inertia_kgm2.copy()
        self._inertia[drive] -= (shaft.drive.inertia_kgm2 or 0.0) * self._gear
        least = elastic.least_inertia_kgm2
        # A chain of springs k has eigenvalues up to 4 k: within this bound the corrected inertia stays positive.
        self._most_lead = 0.25 * _STABLE * np.minimum(least[:-1], least[1:]) / elastic.chain.stiffness
        self.reset()

    @cached_property
    def scales(self) -> ObserverScales:
        """Times and errors that follow from the machine."""
        if self._given is not None:
            return self._given
        first, ratio = self._first_mode()
        full = float(np.sqrt(self._most_lead / LEAD).min())
        # Midpoint rule: relative frequency error (w h)^2 / 12, corrected up to h = full (Fox and Goodwin 1949).
        step = math.sqrt(full**2 + 12.0 * _FREQUENCY_ERROR / first**2)
        return ObserverScales(first, ratio, step, self._numeric_error(step))

    def _full_inertia(self) -> FloatArray:
        """(stations,) mean inertias with the drive's; an unknown drive counts as before the first reading."""
        shaft, inertia = self.elastic.shaft, self._inertia.copy()
        unknown = (1.0 / FIRST_DRIVE - 1.0) * float(inertia.sum())
        known = shaft.drive.inertia_kgm2
        inertia[shaft.drive_station] += unknown if known is None else known * self._gear
        return inertia

    def _static_twist(self) -> FloatArray:
        """(stations,) twist per uniform acceleration under a torque of the drive, 0 at the encoder's station."""
        shaft, inertia, stiffness = self.elastic.shaft, self._inertia, self.elastic.chain.stiffness
        drive, twist = shaft.drive_station, np.zeros(self.elastic.stations)
        for i in range(drive, stiffness.size):
            twist[i + 1] = twist[i] - inertia[i + 1 :].sum() / stiffness[i]
        for i in range(drive - 1, -1, -1):
            twist[i] = twist[i + 1] - inertia[: i + 1].sum() / stiffness[i]
        return twist - twist[shaft.encoder_station]

    def _first_mode(self) -> tuple[float, float]:
        """First natural frequency [rad/s] and damping ratio of the free chain with mean inertias."""
        chain, inertia = self.elastic.chain, self._full_inertia()
        stiffness, damping = assembled(chain.stiffness), assembled(chain.damping) + np.diag(chain.viscous)
        squares, shapes = scipy.linalg.eigh(stiffness, np.diag(inertia))
        first, shape = math.sqrt(max(squares[1], 0.0)), shapes[:, 1]
        return first, float(shape @ damping @ shape) / (2.0 * first)

    def _numeric_error(self, step: float) -> float:
        """Root mean square change of the sensor's torque from the step to a finer one, over its root mean square.

        The drive's station sweeps over the speeds around the nominal one, so that orders of the torque meet the modes.
        """
        elastic, shaft = self.elastic, self.elastic.shaft
        time = np.arange(0.0, _SWEEP_S, _SAMPLE_S)
        slowest, fastest = (factor * self._speed for factor in _SWEEP)
        alpha = np.full(time.size, (fastest - slowest) / _SWEEP_S)
        omega = slowest + alpha * time
        theta, torque = (slowest + 0.5 * alpha * time) * time, np.zeros((time.size, elastic.stations))
        substeps, found = max(math.ceil(_SAMPLE_S / step - 1e-6), 1), []
        for count in (substeps, _FINER * substeps):
            out, chain = outputs(time.size, elastic.stations), self._chain(_SAMPLE_S / count)
            follow(chain, chain_state(chain), shaft.drive_station, time, theta, omega, alpha, count, torque, out)
            found.append(out.pieces[time.size // 8 :, shaft.torque_piece[0]])
        mean = float(np.sqrt(np.mean(found[1] ** 2)))
        return float(np.sqrt(np.mean((found[0] - found[1]) ** 2))) / mean if mean > 0.0 else 0.0

    def _chain(self, step: float) -> ShaftChain:
        """The chain with natural frequencies corrected for a substep, and its own copy of what the drive changes."""
        chain = self.elastic.chain
        lead = np.minimum(LEAD, self._most_lead / step**2)
        return chain._replace(inertia=chain.inertia.copy(), viscous=chain.viscous.copy(), lead=lead)

    def reset(self) -> None:
        """Forget all readings and the estimate of the drive."""
        elastic, shaft, scales = self.elastic, self.elastic.shaft, self.scales
        drive, given = shaft.drive_station, shaft.drive
        others = float(self._inertia.sum())
        self._chain_now, self._state = self._chain(scales.substep_s), chain_state(elastic.chain)
        self._bank = drive_bank(
            _SLIP_SIGMA if given.slip_Nms_rad is None else 0.0,
            _MOBILITY_SIGMA / others if given.inertia_kgm2 is None else 0.0,
            self._memories,
        )
        second = shaft.second_encoder_station
        self._second = second_encoder(
            elastic.chain, self._full_inertia(), shaft.encoder_station, second, self._second_period
        )
        self._room = Room(
            self._inertia, np.zeros(elastic.stations), self._most_lead, np.zeros((5, 5)), self._static_twist()
        )
        self._observer: Any = records(OBSERVER)
        piece, sign = shaft.torque_piece
        beyond = self._inertia[piece + 1 :] if piece >= drive else self._inertia[: piece + 1]
        known = given.inertia_kgm2 is not None
        inertia, slip = (given.inertia_kgm2 or 0.0) * self._gear, (given.slip_Nms_rad or 0.0) * self._gear
        beta = 1.0 / (others + inertia) if known else FIRST_DRIVE / others
        ground = elastic.chain.viscous.copy()
        ground[drive] -= slip
        ring = _RINGING / (scales.damping_ratio * scales.first_mode_rad_s) if scales.damping_ratio > 0.0 else math.inf
        values = {
            "mode": FOLLOWING, "beta": beta, "lam": slip * beta, "others": others, "side": float(beyond.sum()),
            "ground": float(ground.sum()), "drive_ground": float(ground[drive]),
            "drive_disc": float(elastic.chain.inertia[drive]) - inertia,
            "known_inertia": float(known), "known_slip": float(given.slip_Nms_rad is not None), "inertia": inertia,
            "slip": slip, "drive": drive, "encoder": shaft.encoder_station,
            "second": -1.0 if second is None else second, "piece": piece, "sign": sign,
            "substep": scales.substep_s, "numeric": scales.numeric_error,
            "wait": _WAIT_PERIODS * 2.0 * math.pi / scales.first_mode_rad_s, "ring": ring,
            "natural": scales.first_mode_rad_s, "decay": scales.damping_ratio * scales.first_mode_rad_s,
        }  # fmt: skip
        for name, value in values.items():
            self._observer[name] = value

    def restart(self) -> None:
        """Begin another record: reset the motion; the estimated drive and the second encoder's zero remain."""
        for name in ("still", "interval", "torque_square"):
            self._observer[name] = 0.0
        self._observer["mode"] = FOLLOWING

    def repeat(self) -> None:
        """Begin the same record a second time: as `restart`, with the second encoder's zero fixed at its mean."""
        self.restart()
        hold_zero(self._second)

    def take(self, readings: ShaftReadings) -> Observed:
        """Take readings (from `shaft_readings`) in the order of their stamps, in blocks of any size."""
        count = readings.step.size
        found, out = records(STATE, count), outputs(count, self.elastic.stations)
        observe_readings(
            self._chain_now, self._state, self._bank, self._observer, self._room, self._second, readings, found, out
        )
        return Observed(found, out)

    @property
    def drive_inertia_kgm2(self) -> float:
        """Inertia of the drive, given or estimated, at its own station."""
        now = self._observer[0]
        return float(1.0 / now["beta"] - now["others"]) / float(self._gear)

    @property
    def drive_slip_Nms_rad(self) -> float:
        """Slip of the drive, given or estimated, at its own station."""
        now = self._observer[0]
        return float(now["lam"] / now["beta"]) / float(self._gear)
