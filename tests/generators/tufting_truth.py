"""The tufting machine to any number of digits: motion, torque by virtual work, reactions by Newton and Euler.

Complex loop equations as in Xu et al. 2016 (Eq. 1, 14, 15) are differentiated exactly; forces come from the free
bodies, solved as one linear system. Signs: x right, y up, angles counter-clockwise; a reaction is the force of the
ground or the earlier link on the later one; the needle's position counts downwards from C.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import mpmath as mp

from tests.generators.planar_truth import Number, dyad

PARAMETERS: dict[str, str] = {
    "l1_m": "0.015",
    "l2_m": "0.138",
    "l3_m": "0.115",
    "l4_m": "0.125",
    "l5_m": "0.120",
    "l6_m": "0.440",
    "x1_m": "0.070",
    "x2_m": "0.100",
    "H1_m": "0.155",
    "beta1_deg": "168",
    "m1_kg": "3.07",
    "m2_kg": "3.79",
    "m3_kg": "2.96",
    "m4_kg": "1.74",
    "m5_kg": "0.36",
    "m6_kg": "1.47",
    "J1_kgm2": "4.34e-3",
    "J2_kgm2": "26.99e-3",
    "J3_kgm2": "10.77e-3",
    "J4_kgm2": "6.69e-3",
    "J5_kgm2": "0.91e-3",
    "J6_kgm2": "19.15e-3",
    "gravity_m_s2": "9.81",
    "backing_force_N": "1000",
    "free_force_N": "0",
    "backing_plane_m": "0.55784",
}
"""Table 1 and the dynamic analysis of the paper as printed decimals; plane from the stab and exit angles."""

Jet = tuple[Number, Number, Number]
"""A value with its first and second derivative by the crank angle."""


def truth(
    theta: Number,
    omega: Number,
    alpha: Number,
    digits: int = 50,
    parameters: Mapping[str, Number] | None = None,
    reactions: bool = True,
    law: Callable[[Number, bool], Number] | None = None,
) -> dict[str, Number]:
    """Compute every output of the tufting machine at one angle [rad], speed [rad/s] and acceleration [rad/s^2].

    Floats are taken at their exact value, strings as decimals; `parameters` replaces entries of PARAMETERS. The result
    has the output names of the machine. Without `reactions` the linear system is not solved. A `law` gives the force
    against the needle at its distance below C, on the way down (True) or up, in place of the backing's.
    """
    with mp.workdps(digits):
        value = {name: mp.mpf(number) for name, number in {**PARAMETERS, **(parameters or {})}.items()}
        return _Machine(value, mp.mpf(theta), mp.mpf(omega), mp.mpf(alpha)).outputs(reactions, law)


class _Machine:
    """The machine at one angle; links counted 1 to 6 as in the paper."""

    def __init__(self, value: dict[str, Number], theta: Number, omega: Number, alpha: Number) -> None:
        self.value, self.omega, self.alpha = value, omega, alpha
        self.length = [value[f"l{k}_m"] for k in range(1, 7)]
        self.mass = [value[f"m{k}_kg"] for k in range(1, 7)]
        self.inertia = [value[f"J{k}_kgm2"] for k in range(1, 7)]
        self.pins: dict[str, Jet] = {}
        self.angles: list[Jet] = []
        self._close_loops(theta)
        half = {1: "OA", 2: "AB", 3: "CB", 4: "CD", 5: "DE", 6: "EF"}
        self.centroids: list[Jet] = []
        for ends in half.values():
            start, end = self.pins[ends[0]], self.pins[ends[1]]
            self.centroids.append(((start[0] + end[0]) / 2, (start[1] + end[1]) / 2, (start[2] + end[2]) / 2))

    def _close_loops(self, theta: Number) -> None:
        l1, l2, l3, l4, l5, l6 = self.length
        beta = self.value["beta1_deg"] * mp.pi / 180
        origin: Jet = (mp.mpc(0), mp.mpc(0), mp.mpc(0))
        centre = mp.mpc(self.value["x1_m"], self.value["H1_m"])
        crank = _link(origin, l1, (theta, mp.mpf(1), mp.mpf(0)))
        coupler, rocker = dyad(crank, centre, l2, l3, left=True)
        rocker = (rocker[0] % (2 * mp.pi), *rocker[1:])
        fixed: Jet = (centre, mp.mpc(0), mp.mpc(0))
        arm: Jet = (rocker[0] + beta - 2 * mp.pi, rocker[1], rocker[2])
        elbow = _link(fixed, l4, arm)

        across = mp.re(centre) + self.value["x2_m"] - mp.re(elbow[0])
        swing = 2 * mp.pi - mp.acos(across / l5)
        sin, cos = mp.sin(swing), mp.cos(swing)
        turn = mp.re(elbow[1]) / (l5 * sin)
        turn2 = (mp.re(elbow[2]) - l5 * cos * turn**2) / (l5 * sin)
        rod: Jet = (swing, turn, turn2)
        slider = _link(elbow, l5, rod)

        upright: Jet = (3 * mp.pi / 2, mp.mpf(0), mp.mpf(0))
        self.angles = [(theta, mp.mpf(1), mp.mpf(0)), coupler, rocker, arm, rod, upright]
        self.pins = {
            "O": origin,
            "A": crank,
            "B": _link(fixed, l3, rocker),
            "C": fixed,
            "D": elbow,
            "E": slider,
        }
        self.pins["F"] = (slider[0] - 1j * l6, slider[1], slider[2])

    def outputs(self, reactions: bool, law: Callable[[Number, bool], Number] | None = None) -> dict[str, Number]:
        """Compute all outputs by name; the torque comes from virtual work, the reactions from the free bodies."""
        value, omega, alpha = self.value, self.omega, self.alpha
        gravity = value["gravity_m_s2"]
        found: dict[str, Number] = {}
        for k, angle in enumerate(self.angles, 1):
            found[f"theta_{k}_rad"], found[f"omega_{k}_rad_s"] = angle[0], angle[1] * omega
            found[f"alpha_{k}_rad_s2"] = self._acceleration(angle)
            found[f"inertia_torque_{k}_Nm"] = -self.inertia[k - 1] * self._acceleration(angle)
        for k, centroid in enumerate(self.centroids, 1):
            force = -self.mass[k - 1] * self._acceleration(centroid)
            found[f"inertia_force_{k}_x_N"], found[f"inertia_force_{k}_y_N"] = mp.re(force), mp.im(force)
        for name, pin in self.pins.items():
            found[f"point_{name}_x_m"], found[f"point_{name}_y_m"] = mp.re(pin[0]), mp.im(pin[0])

        tip = self.pins["F"]
        below = value["H1_m"] - mp.im(tip[0])
        speed = -mp.im(tip[1]) * omega
        found["needle_position_m"], found["needle_velocity_m_s"] = below, speed
        found["needle_acceleration_m_s2"] = -mp.im(self._acceleration(tip))
        size = value["backing_force_N"] if below >= value["backing_plane_m"] else value["free_force_N"]
        if law is not None:
            size = law(below, speed > 0)
        upward = size * mp.sign(speed)

        inertia = sum(m * abs(c[1]) ** 2 for m, c in zip(self.mass, self.centroids, strict=True))
        inertia += sum(j * a[1] ** 2 for j, a in zip(self.inertia, self.angles, strict=True))
        slope = sum(m * _dot(c[1], c[2]) for m, c in zip(self.mass, self.centroids, strict=True))
        slope += sum(j * a[1] * a[2] for j, a in zip(self.inertia, self.angles, strict=True))
        height = sum(m * mp.im(c[0]) for m, c in zip(self.mass, self.centroids, strict=True))
        climb = sum(m * mp.im(c[1]) for m, c in zip(self.mass, self.centroids, strict=True))
        found["equivalent_inertia_kgm2"], found["equivalent_inertia_slope_kgm2"] = inertia, 2 * slope
        found["kinetic_energy_J"], found["potential_energy_J"] = inertia * omega**2 / 2, gravity * height
        found["torque_inertial_Nm"] = inertia * alpha + slope * omega**2
        found["torque_gravity_Nm"] = gravity * climb
        found["torque_load_Nm"] = -upward * mp.im(tip[1])
        found["balancing_torque_Nm"] = mp.fsum(found[f"torque_{part}_Nm"] for part in ("inertial", "gravity", "load"))
        if reactions:
            self._add_reactions(found, upward)
        return found

    def _add_reactions(self, found: dict[str, Number], upward: Number) -> None:
        """Solve crank, coupler, rocker with arm, rod and slider as free bodies."""
        columns = [f"{pin}{axis}" for pin in "OABCDE" for axis in "xy"] + ["guide", "guide_torque", "torque"]
        bodies: tuple[tuple[tuple[int, ...], dict[str, int]], ...] = (
            ((1,), {"O": 1, "A": -1}),
            ((2,), {"A": 1, "B": -1}),
            ((3, 4), {"B": 1, "C": 1, "D": -1}),
            ((5,), {"D": 1, "E": -1}),
            ((6,), {"E": 1}),
        )
        matrix, right = mp.zeros(15, 15), mp.zeros(15, 1)
        for index, (links, pins) in enumerate(bodies):
            row = 3 * index
            for pin, sign in pins.items():
                x, y = columns.index(pin + "x"), columns.index(pin + "y")
                matrix[row, x] = matrix[row + 1, y] = mp.mpf(sign)
                matrix[row + 2, x] = -sign * mp.im(self.pins[pin][0])
                matrix[row + 2, y] = sign * mp.re(self.pins[pin][0])
            for link in links:
                needed = self._needed_force(link)
                right[row] += mp.re(needed)
                right[row + 1] += mp.im(needed)
                right[row + 2] += _cross(self.centroids[link - 1][0], needed)
                right[row + 2] += self.inertia[link - 1] * self._acceleration(self.angles[link - 1])
        tip = self.pins["E"][0]
        right[13] -= upward
        right[14] -= mp.re(tip) * upward
        matrix[12, columns.index("guide")] = 1
        matrix[14, columns.index("guide")] = -mp.im(tip)
        matrix[14, columns.index("guide_torque")] = 1
        matrix[2, columns.index("torque")] = 1
        solved = dict(zip(columns, mp.lu_solve(matrix, right), strict=True))
        for pin in "OABCDE":
            for axis in "xy":
                found[f"reaction_{pin}_{axis}_N"] = solved[pin + axis]
        found["reaction_guide_N"] = solved["guide"]
        found["balancing_torque_newton_euler_Nm"] = solved["torque"]

        centre, elbow = self.pins["C"][0], self.pins["D"][0]
        on_rod = mp.mpc(solved["Dx"], solved["Dy"])
        needed = _cross(self.centroids[3][0] - centre, self._needed_force(4))
        needed += self.inertia[3] * self._acceleration(self.angles[3])
        found["driven_shaft_torque_Nm"] = needed + _cross(elbow - centre, on_rod)

    def _needed_force(self, link: int) -> Number:
        """Compute the force that joints and loads must exert on a link: mass times acceleration less its weight."""
        gravity = mp.mpc(0, self.value["gravity_m_s2"])
        return self.mass[link - 1] * (self._acceleration(self.centroids[link - 1]) + gravity)

    def _acceleration(self, jet: Jet) -> Number:
        return jet[2] * self.omega**2 + jet[1] * self.alpha


def _link(start: Jet, length: Number, angle: Jet) -> Jet:
    """Compute the far end of a link with its derivatives."""
    arm = length * mp.expj(angle[0])
    return start[0] + arm, start[1] + 1j * angle[1] * arm, start[2] + (1j * angle[2] - angle[1] ** 2) * arm


def _dot(first: Number, second: Number) -> Number:
    return mp.re(first) * mp.re(second) + mp.im(first) * mp.im(second)


def _cross(first: Number, second: Number) -> Number:
    return mp.re(first) * mp.im(second) - mp.im(first) * mp.re(second)
