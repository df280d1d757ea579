"""Three methods for the event times of the needle transfer: event-driven, solve_ivp with events, penalty contact."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine import ContactMachine
from textile_twin_core.machines.needle_transfer import COLLETS, PAD

END_S = 0.0195
"""End time, shortly after the first contact of elements 2 and 3 [s]."""
Times = tuple[float, float]
"""Times of the first contact of element 2 with the pad and with element 3 [s]; infinite without contact."""
Watch = Callable[[float, FloatArray], float]

_APPROACH_LOSS = 10.0
"""Damping of a penalty contact after Hunt and Crossley [s/m]."""


def event_driven(machine: ContactMachine, tolerance: float) -> Times:
    """Integrate by the package's own method: closed forms and power series between events."""
    run = machine.simulate(end_s=END_S, tolerance=tolerance)
    return run.happened("touch", PAD)[0].time_s, run.happened("impact", COLLETS)[0].time_s


class TransferEquations:
    """Equations 13 and 14 of Pejchar and Beran (2011) as plain functions, for solvers of ordinary differential
    equations.

    A state is (x_2, v_2, x_3, v_3).
    """

    def __init__(self, machine: ContactMachine) -> None:
        model = machine.model
        self._law, self._speed = machine.law, machine.nominal_speed_rad_s
        self._duration_s = machine.parameters["forward_duration_s"]
        self._first, self._second = model.springs
        self._m2, self._m3 = (body.mass_kg for body in model.bodies)
        self._pin, self._cone, self._collets = (stop.limit_m for stop in model.stops)
        (self._pad,) = model.pads
        self._start = np.array([machine.start[0], 0.0, machine.start[1], 0.0])

    def _jacket(self, t: float) -> tuple[float, float, float]:
        """Return position, velocity and acceleration of element 1."""
        angle = self._speed * min(t, self._duration_s)
        law = self._law
        return law.evaluate(angle), law.evaluate(angle, 1) * self._speed, law.evaluate(angle, 2) * self._speed**2

    def _forces(self, x1: float, v1: float, y: FloatArray, on_pad: bool) -> tuple[float, float]:
        """Return the forces on elements 2 and 3 without those of the stops."""
        x2, v2, x3, v3 = y.tolist()
        first, second, pad = self._first, self._second, self._pad
        pull = second.stiffness_N_m * (x3 - x2 - second.free_length_m) + second.damping_Ns_m * (v3 - v2)
        on_2 = -first.stiffness_N_m * (x2 - x1 - first.free_length_m) - first.damping_Ns_m * (v2 - v1) + pull
        if on_pad:
            on_2 -= pad.force(x2 - pad.position_m) + pad.damping_Ns_m * v2
        return on_2, -pull

    def with_events(self, method: str, tolerance: float) -> Times:
        """Integrate by scipy's solve_ivp, one call per contact state, each ended by its terminal events."""
        t, y = 0.0, self._start
        pin, cone, pad = True, True, False
        touched = math.inf
        while t < END_S:
            watch = self._watch(pin, cone, pad)
            part = solve_ivp(
                self._right_side(pin, cone, pad), (t, END_S), y, method, rtol=tolerance, atol=tolerance * 1e-3,
                events=list(watch.values()),
            )  # fmt: skip
            t, y = float(part.t[-1]), part.y[:, -1].copy()
            hit = next((name for name, at in zip(watch, part.t_events, strict=True) if at.size), "")
            if hit == "meet":
                return touched, t
            if hit == "pad":
                touched = min(touched, t)
                pad, pin = not pad, pin and pad
            elif hit == "pin":
                pin = not pin
                y[1] = self._jacket(t)[1] if pin else y[1]
            elif hit == "cone":
                cone = not cone
                y[3] = self._jacket(t)[1] if cone else y[3]
        return touched, math.inf

    def _right_side(self, pin: bool, cone: bool, pad: bool) -> Callable[[float, FloatArray], list[float]]:
        def right_side(t: float, y: FloatArray) -> list[float]:
            x1, v1, a1 = self._jacket(t)
            on_2, on_3 = self._forces(x1, v1, y, pad)
            two = (v1, a1) if pin else (float(y[1]), on_2 / self._m2)
            three = (v1, a1) if cone else (float(y[3]), on_3 / self._m3)
            return [*two, *three]

        return right_side

    def _watch(self, pin: bool, cone: bool, pad: bool) -> dict[str, Watch]:
        """Return the functions that end a contact state when they turn negative: a tensile stop force or a
        closing gap.
        """

        def surplus(element: int, mass: float) -> Watch:
            def force(t: float, y: FloatArray) -> float:
                x1, v1, a1 = self._jacket(t)
                return self._forces(x1, v1, y, pad)[element] - mass * a1

            return force

        side = 1.0 if pad else -1.0
        found: dict[str, Watch] = {
            "pad": lambda t, y: side * float(y[0] - self._pad.position_m),
            "meet": lambda t, y: float(y[0] + self._collets - y[2]),
            "pin": surplus(0, self._m2) if pin else lambda t, y: float(self._jacket(t)[0] + self._pin - y[0]),
            "cone": surplus(1, self._m3) if cone else lambda t, y: float(self._jacket(t)[0] + self._cone - y[2]),
        }
        for function in found.values():
            _mark(function, terminal=True)
        return found

    def with_penalty(self, stiffness_N_m: float) -> Times:
        """Integrate with stops as stiff springs, damped after Hunt and Crossley (1975), in one call of solve_ivp
        (LSODA).
        """

        def stop(depth: float, rate: float) -> float:
            return max(stiffness_N_m * depth * (1.0 + _APPROACH_LOSS * rate), 0.0) if depth > 0.0 else 0.0

        def right_side(t: float, y: FloatArray) -> list[float]:
            x1, v1, _ = self._jacket(t)
            x2, v2, x3, v3 = y.tolist()
            on_2, on_3 = self._forces(x1, v1, y, x2 > self._pad.position_m)
            on_2 -= stop(x2 - x1 - self._pin, v2 - v1)
            on_3 -= stop(x3 - x1 - self._cone, v3 - v1)
            return [v2, on_2 / self._m2, v3, on_3 / self._m3]

        def pad(t: float, y: FloatArray) -> float:
            return float(self._pad.position_m - y[0])

        def meet(t: float, y: FloatArray) -> float:
            return float(y[0] + self._collets - y[2])

        _mark(pad, terminal=False)
        _mark(meet, terminal=True)
        part = solve_ivp(right_side, (0.0, END_S), self._start, "LSODA", rtol=1e-9, atol=1e-13, events=(pad, meet))
        touched, met = part.t_events
        return float(touched[0]) if touched.size else math.inf, float(met[0]) if met.size else math.inf


def _mark(function: Watch, terminal: bool) -> None:
    """Set the attributes of an event function for solve_ivp: it triggers on falling through zero."""
    vars(function).update(direction=-1.0, terminal=terminal)
