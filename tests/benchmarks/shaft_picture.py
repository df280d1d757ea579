"""The picture of docs/shaft.md: the acceleration of a tufting machine's shaft, true and estimated from its encoder.

The motion is that of `ttc.drive`: a motor with slip, a flywheel, the needles' path through the backing.

    python -m tests.benchmarks.shaft_picture docs/shaft.png
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np

import textile_twin_core as ttc
from tests.benchmarks.plots import style
from tests.shaft.textbook import textbook
from textile_twin_core.dynamics.body import Body
from textile_twin_core.shaft import create_estimator

BITS, RATE_HZ, DURATION_S, LATE_S = 13, 500.0, 12.0, 20e-6
SPEED_RAD_S, SLIP_NMS, LOAD_NM, FLYWHEEL_KGM2 = 16.8, 2.0, 4.0, 0.4
SHOWN_S = (10.0, 10.8)


def main(path: Path) -> None:
    """Draw it into a PNG."""
    machine = ttc.machines.tufting()
    machine = dataclasses.replace(machine, bodies=(*machine.bodies, Body.flywheel(FLYWHEEL_KGM2)))
    time = np.arange(RATE_HZ * DURATION_S) / RATE_HZ

    def motor(_time: float, _theta: float, omega: float) -> float:
        return SLIP_NMS * (SPEED_RAD_S - omega) + LOAD_NM

    true = ttc.drive(machine, motor, 0.3, SPEED_RAD_S, time)
    late = np.random.default_rng(1).normal(0.0, LATE_S, time.size)
    step = 2.0 * np.pi / 2**BITS
    angle = np.round((true.theta_rad + true.omega_rad_s * late) / step) * step
    book = textbook(time, angle)
    causal, smooth = create_estimator("causal"), create_estimator("smooth")
    smooth.step(time, angle)
    views = (("live", causal.step(time, angle), book.causal), ("from the whole record", smooth.finish(), book.smooth))
    figure = style.new_figure(9.0, 5.8)
    for row, (title, states, tuned) in enumerate(views):
        axes = figure.add_subplot(2, 1, row + 1)
        shown = (time[states.index] >= SHOWN_S[0]) & (time[states.index] <= SHOWN_S[1])
        index, estimate, sigma = states.index[shown], states.alpha_rad_s2[shown], states.sigma[shown, 2]
        axes.plot(
            time[index], tuned[index, 2], color=style.LIMIT, linewidth=1.0, label="textbook's, tuned to this record"
        )
        axes.fill_between(
            time[index], estimate - 2.0 * sigma, estimate + 2.0 * sigma, color=style.OURS, alpha=0.25, linewidth=0.0,
            label="two sigmas",
        )  # fmt: skip
        axes.plot(time[index], estimate, color=style.OURS, linewidth=1.6, label="estimated")
        axes.plot(time[index], true.alpha_rad_s2[index], color=style.INK, linewidth=1.0, linestyle="--", label="true")
        rms = [np.sqrt(np.mean((values - true.alpha_rad_s2[index]) ** 2)) for values in (estimate, tuned[index, 2])]
        style.dress(axes, "time [s]" if row else "", "acceleration [rad/s²]")
        axes.set(xscale="linear", yscale="linear", xlim=SHOWN_S)
        axes.set_title(f"{title}: off by {rms[0]:.2g} rad/s² RMS, textbook's {rms[1]:.2g}", loc="left", color=style.INK)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    style.save(figure, path)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
