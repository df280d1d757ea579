"""Draws docs/explanation/sample_to_torque.png: two turns of a recording, from the encoder's angle to the residual."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch

import textile_twin_core as ttc
from textile_twin_core.recordings import open_bag

ROOT = Path(__file__).resolve().parents[1]
LINKS = (("O", "A"), ("A", "B"), ("C", "B"), ("C", "D"), ("D", "E"), ("E", "F"))
BEGIN_S, END_S = 12.0, 12.75
STEPS = (
    ("1  Encoder", "An angle and the time of\nits reading, 500 times\na second"),
    ("2  Estimator", "Angle, speed, acceleration,\nand how far off each may be"),
    ("3  Linkage", "Place and slope of every\nlink at this angle, in\nclosed form"),
    ("4  Torque", "What moves the masses,\nlifts the weights, pushes\nthe needle: the sum"),
    ("5  Sensor model", "Gain, offset, delay: what the\ntorque sensor should show"),
    ("6  Residual", "Measured minus predicted:\nwhat the verdict reads"),
)


def main() -> None:
    """Draw and write."""
    bag = open_bag(ROOT / "bags" / "tufting_160rpm_synthetic")
    angle, torque = bag.read_angles("main_shaft/angle"), bag.read_torques("balancing_torque/measured")
    points = [f"point_{name}_{axis}_m" for name in "OABCDEF" for axis in "xy"]
    parts = ("torque_inertial_Nm", "torque_gravity_Nm", "torque_load_Nm")
    twin = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm", *parts, *points])
    session = twin.session(shaft="smooth")
    session.step(angle.stamps, angle.angles_rad)
    found = session.finish()

    start = angle.stamps[0]
    time = (found.stamps - start) * 1e-9
    shown = (time > BEGIN_S) & (time < END_S)
    measured_time = (torque.stamps - start) * 1e-9
    window = (measured_time > BEGIN_S) & (measured_time < END_S)
    read_time = (angle.stamps - start) * 1e-9
    readings = (read_time > BEGIN_S) & (read_time < END_S)
    late = 0.002
    sensed = 1.01 * np.interp(measured_time - late, time, found["balancing_torque_Nm"])

    figure, rows = plt.subplots(
        len(STEPS),
        1,
        figsize=(6.6, 10.5),
        gridspec_kw={"left": 0.47, "right": 0.97, "top": 0.985, "bottom": 0.045, "hspace": 0.42},
    )
    rows[0].plot(read_time[readings], angle.angles_rad[readings], ".", ms=2.5, color="tab:blue")
    rows[0].set_ylabel("angle [rad]")
    speed, sigma = found.omega_rad_s[shown], np.sqrt(found.states.covariance[shown, 1, 1])
    rows[1].plot(time[shown], speed, color="tab:blue")
    rows[1].fill_between(time[shown], speed - 2 * sigma, speed + 2 * sigma, alpha=0.3)
    rows[1].set_ylabel("speed [rad/s]")
    draw_linkage(rows[2], {name: float(found[name][np.argmax(shown)]) for name in points})
    for name, colour in zip(parts, ("tab:green", "tab:brown", "tab:purple"), strict=True):
        rows[3].plot(time[shown], found[name][shown], color=colour, lw=1, label=name.split("_")[1])
    rows[3].plot(time[shown], found["balancing_torque_Nm"][shown], color="black", lw=1.6, label="sum")
    rows[3].set_ylabel("torque [N m]")
    rows[3].legend(
        fontsize=6.5, ncols=4, loc="lower center", frameon=False, bbox_to_anchor=(0.5, 0.97), columnspacing=1
    )
    rows[4].plot(measured_time[window], sensed[window], color="black", label="predicted")
    rows[4].plot(measured_time[window], torque.torque_Nm[window], ".", ms=2.5, color="tab:orange", label="measured")
    rows[4].set_ylabel("torque [N m]")
    rows[4].legend(fontsize=6.5, ncols=2, loc="lower center", frameon=False, bbox_to_anchor=(0.5, 0.97))
    rows[5].plot(measured_time[window], (torque.torque_Nm - sensed)[window], color="tab:red", lw=1)
    rows[5].axhline(0.0, color="black", lw=0.5)
    rows[5].set(ylabel="residual [N m]", ylim=(-1.0, 1.6), xlabel="time [s]")
    for row in (each for k, each in enumerate(rows) if k != 2):
        row.set_xlim(BEGIN_S, END_S)
        row.tick_params(labelsize=7)
        row.yaxis.label.set_size(8)
        row.xaxis.label.set_size(8)
        row.spines[["top", "right"]].set_visible(False)
    for k, (row, (title, text)) in enumerate(zip(rows, STEPS, strict=True)):
        place = row.get_position()
        middle = 0.5 * (place.y0 + place.y1)
        box = {"boxstyle": "round,pad=0.5", "facecolor": "#e0f2f1", "edgecolor": "#00796b"}
        figure.text(0.03, middle + 0.024, title, fontsize=11, weight="bold", va="center", color="#004d40")
        figure.text(0.03, middle - 0.02, text, fontsize=8.5, va="center", bbox=box, linespacing=1.35)
        if k + 1 < len(STEPS):
            end = rows[k + 1].get_position()
            arrow = FancyArrowPatch(
                (0.16, middle - 0.058), (0.16, 0.5 * (end.y0 + end.y1) + 0.04), transform=figure.transFigure,
                arrowstyle="-|>", mutation_scale=14, color="#00796b", lw=1.5,
            )  # fmt: skip
            figure.add_artist(arrow)
    figure.savefig(ROOT / "docs" / "explanation" / "sample_to_torque.png", dpi=150)


def draw_linkage(axes: Axes, places: dict[str, float]) -> None:
    """Draw the tufting linkage, turned so that the needle points to the right."""
    at = {name: (-places[f"point_{name}_y_m"], places[f"point_{name}_x_m"]) for name in "OABCDEF"}
    for name, (x, y) in at.items():
        if name in "OC":
            axes.plot(x, y, "k^", ms=7)
        axes.annotate(name, (x, y), xytext=(3, 4), textcoords="offset points", fontsize=8)
    for first, second in LINKS:
        axes.plot(*zip(at[first], at[second], strict=True), "o-", ms=4, lw=2.5)
    axes.set_aspect("equal")
    axes.set_anchor("W")
    axes.axis("off")


if __name__ == "__main__":
    main()
