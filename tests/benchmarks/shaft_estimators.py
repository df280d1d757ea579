"""Table and plot of the shaft estimators: torque error against latency and cost, over encoder bits, speeds and knocks.

Run `python -m tests.benchmarks.shaft_estimators [--seeds N] [--json FILE] [--png FILE]` from the project's root. The
signal is that of tests/shaft/shaft_signal.py, truth and torque those of tests/shaft/tufting_torque.py; nothing of the
engine is used. Cost is processor time per sample, the samples given in one block.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from tests.shaft.judge import judge
from tests.shaft.shaft_signal import ShaftSignal, make_signal

LATENCY_S = {"causal": 0.0, "lag 20 ms": 0.02, "lag 40 ms": 0.04, "lag 80 ms": 0.08, "smooth": 6.0}
"""Of `smooth` half of the 12 s record."""
FIRST_SEED = 7000


def row(label: str, signals: list[ShaftSignal], **about: object) -> dict[str, object]:
    """One line of the table: an estimator on some signals."""
    name, *rest = label.split()
    settings = {"shaft_lag_s": float(rest[0]) / 1e3} if rest else {}
    started = time.process_time()
    found = [judge(name, signal, **settings) for signal in signals]
    seconds = time.process_time() - started
    errors = np.array([one.torque_rms for one in found])
    inside = np.mean([one.inside for one in found], axis=0)
    return {
        "estimator": label,
        **about,
        "torque_rms_Nm": float(np.sqrt(np.mean(errors**2))),
        "torque_rms_worst_Nm": float(errors.max()),
        "inside_theta": float(inside[0]),
        "inside_omega": float(inside[1]),
        "inside_alpha": float(inside[2]),
        "inside_torque": float(inside[3]),
        "latency_s": LATENCY_S[label],
        "us_per_sample": 1e6 * seconds / sum(signal.angles.size for signal in signals),
    }


def table(seeds: int) -> list[dict[str, object]]:
    """Every estimator at 160 rpm over bits, with and without knocks; and at other speeds."""
    rows = []
    for knocks in (False, True):
        for bits in (8, 10, 12, 14, 16):
            signals = [make_signal(FIRST_SEED + i, bits=bits, knocks=knocks) for i in range(seeds)]
            for label in LATENCY_S:
                if bits in (8, 12, 16) or "lag" not in label:
                    rows.append(row(label, signals, bits=bits, rpm=160.0, knocks=knocks))
                    print(line(rows[-1]), flush=True)
    for rpm in (20.0, 60.0, 400.0):
        signals = [make_signal(FIRST_SEED + i, rpm=rpm) for i in range(seeds)]
        for label in ("causal", "lag 40 ms", "smooth"):
            rows.append(row(label, signals, bits=16, rpm=rpm, knocks=False))
            print(line(rows[-1]), flush=True)
    return rows


def line(one: dict[str, object]) -> str:
    """A row as text."""
    knocks = "knocks" if one["knocks"] else "steady"
    return (
        f"{one['estimator']:<10} {one['bits']:>2} bit {one['rpm']:>4.0f} rpm {knocks} torque {one['torque_rms_Nm']:.1e}"
        f" (worst {one['torque_rms_worst_Nm']:.1e}) N m  inside 1 sigma: theta {one['inside_theta']:.2f} "
        f"omega {one['inside_omega']:.2f} alpha {one['inside_alpha']:.2f} torque {one['inside_torque']:.2f}  "
        f"{one['us_per_sample']:.0f} us"
    )


def plot(rows: list[dict[str, object]], path: Path) -> None:
    """Torque error against latency and against cost, at 16 bits."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
    for knocks, colour in ((False, "tab:blue"), (True, "tab:red")):
        for bits, marker in ((16, "o"), (12, "s"), (8, "^")):
            chosen = [one for one in rows if (one["knocks"], one["bits"], one["rpm"]) == (knocks, bits, 160.0)]
            label = f"{'with load knocks' if knocks else 'steady'}, {bits} bit"
            torque = [one["torque_rms_Nm"] for one in chosen]
            latency = [max(float(str(one["latency_s"])), 2e-3) for one in chosen]
            axes[0].loglog(latency, torque, marker=marker, color=colour, label=label, linewidth=1)
            cost = [one["us_per_sample"] for one in chosen]
            axes[1].loglog(cost, torque, marker=marker, color=colour, linestyle="", label=label)
    axes[0].set_xlabel("latency [s]  (causal: one sample)")
    axes[0].set_ylabel("RMS error of the smooth torque [N m]")
    axes[1].set_xlabel("cost [us per sample]")
    for axis in axes:
        axis.grid(True, which="both", alpha=0.3)
        axis.axhline(0.0325, color="grey", linestyle=":", label="acceleration left out")
    axes[1].legend(fontsize=7, loc="center")
    figure.savefig(path, dpi=120)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description="torque error of the shaft estimators against latency and cost")
    parser.add_argument("--seeds", type=int, default=4, help="records per line (default 4)")
    parser.add_argument("--json", type=Path, help="write the rows here")
    parser.add_argument("--png", type=Path, help="draw them here")
    options = parser.parse_args()
    rows = table(options.seeds)
    if options.json:
        options.json.write_text(json.dumps({"rows": rows}, indent=1) + "\n")
    if options.png:
        plot(rows, options.png)


if __name__ == "__main__":
    main()
