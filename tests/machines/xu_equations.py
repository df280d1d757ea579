"""The equations of Xu et al. 2016 as printed, with optional corrections of each misprint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

L1, L2, L3, L4, L5, L6 = 0.015, 0.138, 0.115, 0.125, 0.120, 0.440
X1, X2, H1 = 0.070, 0.100, 0.155
BETA1 = np.radians(168.0)
M = {1: 3.07, 2: 3.79, 3: 2.96, 4: 1.74, 5: 0.36, 6: 1.47}
J = {1: 4.34e-3, 2: 26.99e-3, 3: 10.77e-3, 4: 6.69e-3, 5: 0.91e-3}
G = 9.81
W1 = 160.0 * 2.0 * np.pi / 60.0


@dataclass(frozen=True)
class Mended:
    """Choice of the misprints to correct."""

    eq_9: bool = True
    eq_14: bool = True
    eq_23: bool = True
    eq_33: bool = True
    eq_35: bool = True


def motion(t1: float, mended: Mended = Mended()) -> dict[str, float]:
    """Eq. 2 to 18: angles, speeds and accelerations of the rods, place of the needle."""
    phi1 = np.arctan(X1 / H1)
    oc = np.hypot(H1, X1)
    phi4 = np.pi / 2 - phi1 - t1
    ac = np.sqrt(L1**2 + oc**2 - 2 * L1 * oc * np.cos(phi4))
    phi2 = np.arcsin(L1 / ac * np.sin(phi4))
    phi3 = np.arccos((ac**2 + L3**2 - L2**2) / (2 * ac * L3)) - phi2
    t3 = 3 * np.pi / 2 - phi1 - phi3
    t2 = np.arcsin((L3 * np.sin(t3) - L1 * np.sin(t1) + H1) / L2)
    if mended.eq_9:
        t2 = np.pi - t2
    w2 = -L1 * W1 * np.sin(t1 - t3) / (L2 * np.sin(t2 - t3))
    w3 = L1 * W1 * np.sin(t1 - t2) / (L3 * np.sin(t3 - t2))
    a2 = (L3 * w3**2 - L1 * W1**2 * np.cos(t1 - t3) - L2 * w2**2 * np.cos(t2 - t3)) / (L2 * np.sin(t2 - t3))
    a3 = (L2 * w2**2 + L1 * W1**2 * np.cos(t1 - t2) - L3 * w3**2 * np.cos(t3 - t2)) / (L3 * np.sin(t3 - t2))
    t4, w4, a4 = t3 + BETA1 - 2 * np.pi, w3, a3
    t5 = np.arccos((X2 - L4 * np.cos(t4)) / L5)
    if mended.eq_14:
        t5 = 2 * np.pi - t5
    w5 = -L4 * w4 * np.sin(t4) / (L5 * np.sin(t5))
    a5 = -(L4 * a4 * np.sin(t4) + L4 * w4**2 * np.cos(t4) + L5 * w5**2 * np.cos(t5)) / (L5 * np.sin(t5))
    return {
        **{"t2": t2, "w2": w2, "a2": a2, "t3": t3, "w3": w3, "a3": a3, "t4": t4, "w4": w4, "a4": a4},
        **{"t5": t5, "w5": w5, "a5": a5},
        "needle": L6 - L4 * np.sin(t4) - L5 * np.sin(t5),
        "needle_speed": -L4 * w4 * np.cos(t4) - L5 * w5 * np.cos(t5),
        # not printed: the derivative of Eq. 17
        "needle_acceleration": L4 * (w4**2 * np.sin(t4) - a4 * np.cos(t4))
        + L5 * (w5**2 * np.sin(t5) - a5 * np.cos(t5)),
    }


def centroid_accelerations(t1: float, mended: Mended = Mended()) -> dict[int, complex]:
    """Eq. 20, 23, 26, 33, 36."""
    k = motion(t1, mended)
    along = {i: np.exp(1j * k[f"t{i}"]) for i in (2, 3, 4, 5)}
    first = (L1 if mended.eq_23 else L2) * W1**2
    w4 = k["w4"] ** 2 if mended.eq_33 else k["w4"]
    return {
        1: -L1 / 2 * W1**2 * np.exp(1j * t1),
        2: -first * np.exp(1j * t1) + L2 / 2 * (1j * k["a2"] - k["w2"] ** 2) * along[2],
        3: L3 / 2 * (1j * k["a3"] - k["w3"] ** 2) * along[3],
        4: L4 / 2 * (1j * k["a4"] - w4) * along[4],
        5: L4 * (1j * k["a4"] - k["w4"] ** 2) * along[4] + L5 / 2 * (1j * k["a5"] - k["w5"] ** 2) * along[5],
    }


def forces(t1: float, friction: float, mended: Mended = Mended()) -> dict[str, float]:
    """Solve Eq. 29 to 32 and 40 to 43 without their empty columns; friction is 0 outside the backing."""
    k, s = motion(t1, mended), centroid_accelerations(t1, mended)
    f = {i: -M[i] * a for i, a in s.items()}
    torque = {i: -J[i] * k[f"a{i}"] for i in (2, 3, 4, 5)}
    a = L1 * np.exp(1j * t1)
    b = a + L2 * np.exp(1j * k["t2"])
    c = X1 + 1j * H1
    d = c + L4 * np.exp(1j * k["t4"])
    e = d + L5 * np.exp(1j * k["t5"])
    s1, s2, s3, s4, s5 = a / 2, (a + b) / 2, (b + c) / 2, (c + d) / 2, (d + e) / 2
    f6 = M[6] * k["needle_acceleration"]  # -m6 a, the needle counted downwards
    fr = friction if k["needle_speed"] > 0 else -friction

    def x(p: complex, q: complex) -> float:
        return float((p - q).real)

    def y(p: complex, q: complex) -> float:
        return float((p - q).imag)

    eq_41 = np.array(
        [
            [1, 0, 1, 0, 0, 0, 0, 0],
            [0, 1, 0, 1, 0, 0, 0, 0],
            [-y(s4, c), x(s4, c), y(d, s4), -x(d, s4), 0, 0, 0, 1],
            [0, 0, -1, 0, 1, 0, 0, 0],
            [0, 0, 0, -1, 0, 1, 0, 0],
            [0, 0, y(d, s5), -x(d, s5), y(s5, e), -x(s5, e), 0, 0],
            [0, 0, 0, 0, -1, 0, 1, 0],
            [0, 0, 0, 0, 0, -1, 0, 0],
        ]
    )
    m4 = torque[4] if mended.eq_35 else -torque[4]
    eq_43 = np.array(
        [
            *(-f[4].real, -f[4].imag + M[4] * G, m4),
            *(-f[5].real, -f[5].imag + M[5] * G, -torque[5]),
            *(0.0, -f6 - fr + M[6] * G),
        ]
    )
    cx, cy, dx, dy, ex, ey, guide, mr = np.linalg.solve(eq_41, eq_43)
    eq_30 = np.array(
        [
            [1, 0, 1, 0, 0, 0, 0, 0, 0],
            [0, 1, 0, 1, 0, 0, 0, 0, 0],
            [-y(a, s1), x(a, s1), y(s1, 0), -x(s1, 0), 0, 0, 0, 0, 1],
            [-1, 0, 0, 0, 1, 0, 0, 0, 0],
            [0, -1, 0, 0, 0, 1, 0, 0, 0],
            [y(a, s2), x(s2, a), 0, 0, y(s2, b), x(b, s2), 0, 0, 0],
            [0, 0, 0, 0, -1, 0, 1, 0, 0],
            [0, 0, 0, 0, 0, -1, 0, 1, 0],
            [0, 0, 0, 0, -y(s3, b), x(s3, b), -y(c, s3), x(c, s3), 0],
        ]
    )
    eq_32 = np.array(
        [
            *(-f[1].real, -f[1].imag + M[1] * G, 0.0),
            *(-f[2].real, -f[2].imag + M[2] * G, -torque[2]),
            *(-f[3].real, -f[3].imag + M[3] * G, -torque[3] - mr),
        ]
    )
    ax, ay, ox, oy, bx, by, c3x, c3y, mb = np.linalg.solve(eq_30, eq_32)
    return {
        "balancing_torque_Nm": mb,
        "driven_shaft_torque_Nm": -mr,
        # the paper gives the force of the later rod on the earlier one, the machine the opposite
        **{"reaction_O_x_N": ox, "reaction_O_y_N": oy, "reaction_A_x_N": -ax, "reaction_A_y_N": -ay},
        **{"reaction_B_x_N": -bx, "reaction_B_y_N": -by, "reaction_C_x_N": c3x + cx, "reaction_C_y_N": c3y + cy},
        **{"reaction_D_x_N": -dx, "reaction_D_y_N": -dy, "reaction_E_x_N": -ex, "reaction_E_y_N": -ey},
        "reaction_guide_N": guide,
    }
