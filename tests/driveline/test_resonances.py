"""Natural frequencies against openTorsion, critical speeds against simulated run-ups, and the command."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray
from textile_twin_core.cli.main import main
from textile_twin_core.compiling import compiled
from textile_twin_core.driveline import bare_shaft, chain_state, elastic_shaft, find_modes, find_resonances
from textile_twin_core.driveline.chain import ShaftChain
from textile_twin_core.driveline.runs import Outputs, observe, outputs, twist_statically
from textile_twin_core.driveline.step import ChainState, midpoint_step
from textile_twin_core.errors import MotionError
from textile_twin_core.machine import EvenShaft, Machine, MainShaft, ShaftDrive, ShaftPiece, Station

# The laboratory drive train of U. Hakonen's thesis (urho-h/torque_estimation_masters, src/testbench_model_minimal.py)
INERTIAS = [
    7.94e-4, 3.79e-6, 3.00e-6, 2.00e-6, 7.81e-3, 2.00e-6, 3.29e-6, 5.01e-5, 6.50e-6, 5.65e-5, 4.27e-6, 3.25e-4,
    1.20e-4, 1.15e-5, 1.32e-4, 4.27e-6, 2.69e-4, 1.80e-4, 2.00e-5, 2.00e-4, 4.27e-6, 4.95e-2,
]  # fmt: skip
STIFFNESSES = [
    1.90e5, 6.95e3, 90.00, 90.00, 90.00, 90.00, 94.064, 4.19e4, 5.40e3, 4.19e4, 1.22e3, 4.33e4, 3.10e4, 1.14e3, 3.10e4,
    1.22e4, 4.43e4, 1.38e5, 2.00e4, 1.38e5, 1.22e4,
]  # fmt: skip
DAMPINGS = [
    8.08, 0.29, 0.24, 0.24, 0.24, 0.24, 0.00, 1.78, 0.23, 1.78, 0.52, 1.84, 1.32, 0.05, 1.32, 0.52, 1.88, 5.86, 0.85,
    5.86, 0.52,
]  # fmt: skip
BEARINGS = {0: 0.0030, 11: 0.0042, 16: 0.0042, 21: 0.2400}
GEARS = {11: 3.0, 16: 4.0}
# Of openTorsion 0.3.2: scipy.linalg.eigh of its K and M (first row), |eigenvalue| of its modal_analysis, swinging modes
BENCH_HZ = [
    28.039696577356938, 39.640010385295405, 68.321381326083042, 299.88966118004259, 571.79234758120322,
    937.04220464103037, 1505.2150741509697, 1551.0665234846051, 1683.9554693537541, 1709.3188482779099,
    2126.0499728192694, 2980.4690360531598, 3022.8566108789296, 7584.3268712013432, 8830.4853995840749,
]  # fmt: skip
BENCH_DAMPED_HZ = [
    28.9239055, 39.70936767, 69.97995105, 300.75246453, 674.74132237, 1551.07144497, 1709.31818166, 2023.70433023,
    2977.16148579, 3022.85417345,
]  # fmt: skip

OPENTORSION_17_HZ = [
    197.32501782087093,
    392.74968785129505,
    584.391963688896,
    770.4062254550289,
    949.0010541231466,
    1118.4564838633137,
    1277.140566253369,
    1423.525086834354,
    1556.2002826511548,
    1673.8884190404162,
    1775.45609491383,
    1859.925158030195,
    1926.4821251362148,
    1974.4860162549192,
    2003.4745276732383,
    2013.1684841794813,
]


def bench() -> MainShaft:
    names = [f"d{k}" for k in range(22)]
    discs = [
        Station(name, inertia, BEARINGS.get(k, 0.0))
        for k, (name, inertia) in enumerate(zip(names, INERTIAS, strict=True))
    ]
    pieces = [
        ShaftPiece(names[k], names[k + 1], STIFFNESSES[k], DAMPINGS[k], gear_ratio=GEARS.get(k, 1.0)) for k in range(21)
    ]
    return MainShaft(tuple(discs), tuple(pieces))


def wide(inertia: float = 1.0, slip: float | None = None) -> Machine:
    even = EvenShaft(0.06, 4.0, 16, damping_Nms_rad=1.25, drive=ShaftDrive(inertia_kgm2=inertia, slip_Nms_rad=slip))
    return replace(ttc.machines.tufting(), shaft=even.main_shaft(), linkages=even.places())


def test_a_published_bench_with_gears_has_the_frequencies_of_opentorsion() -> None:
    modes = find_modes(bare_shaft(bench()))
    found = [mode.undamped_Hz for mode in modes]
    assert found[: len(BENCH_HZ)] == pytest.approx(BENCH_HZ, rel=1e-9)
    assert len(found) == 21
    swinging = [mode for mode in modes if mode.damped_Hz > 0.0]
    sizes = sorted(mode.damped_Hz / math.sqrt(1.0 - mode.damping_ratio**2) for mode in swinging)
    assert sizes == pytest.approx(BENCH_DAMPED_HZ, rel=2e-9)
    assert all(mode.damping_ratio >= 1.0 for mode in modes if mode.damped_Hz == 0.0)


def test_a_chain_of_seventeen_discs_has_the_frequencies_of_opentorsion() -> None:
    """And of the closed form of a uniform chain with half discs at its ends: 2 sqrt(k / J) sin(pi m / 32)."""
    names = [f"s{k}" for k in range(17)]
    discs = [Station(name, 0.005 if k in (0, 16) else 0.01) for k, name in enumerate(names)]
    shaft = MainShaft(tuple(discs), tuple(ShaftPiece(a, b, 4.0e5) for a, b in pairwise(names)))
    found = [mode.undamped_Hz for mode in find_modes(bare_shaft(shaft))]
    closed = [math.sqrt(4.0e5 / 0.01) / math.pi * math.sin(math.pi * m / 32.0) for m in range(1, 17)]
    assert found == pytest.approx(closed, rel=1e-12)
    assert found == pytest.approx(OPENTORSION_17_HZ, rel=1e-9)


def test_a_shape_has_the_angles_of_the_stations_behind_gears() -> None:
    """The springs carry little torque where little moves in the lowest mode: shape over gear ratio is smooth."""
    mode = find_modes(bare_shaft(bench()))[0]
    assert np.abs(mode.shape).max() == 1.0
    assert mode.shape[12] == pytest.approx(mode.shape[11] / 3.0, rel=1e-2)


def test_frequencies_over_the_turn_hold_the_mean_between_them() -> None:
    first = find_modes(elastic_shaft(wide()))[0]
    assert first.undamped_Hz == pytest.approx(112.26, abs=0.01)  # the issue of a wide machine: 112 Hz
    assert first.lowest_Hz < 0.97 * first.undamped_Hz < 1.03 * first.undamped_Hz < first.highest_Hz


def order_amplitude(
    t: FloatArray, theta: FloatArray, values: FloatArray, order: int, turns: int
) -> tuple[FloatArray, FloatArray]:
    """Mean speed and amplitude of an order in windows of whole turns, one turn apart."""
    grid = np.arange(theta[0], theta[-1], 2.0 * np.pi / 256.0)
    at = np.interp(grid, theta, values) * np.exp(-1j * order * grid)
    mean = np.convolve(at, np.full(256 * turns, 1.0 / (256 * turns)), "valid")[::256]
    edges = np.interp(theta[0] + 2.0 * np.pi * np.arange(mean.size + turns), theta, t)
    return 2.0 * np.pi * turns / (edges[turns:] - edges[:-turns]), 2.0 * np.abs(mean)


@compiled
def run_free(
    chain: ShaftChain,
    state: ChainState,
    base: FloatArray,
    time: FloatArray,
    substeps: int,
    torque: FloatArray,
    reference: FloatArray,
    out: Outputs,
) -> None:
    """Run with all stations free under external torques (samples, stations), straight lines between the samples.

    base: angle and speed of the reference [rad, rad/s], moved to the first station after each sample; `reference`
    (samples,) gets its angle at each sample.
    """
    n = chain.inertia.size
    now = np.zeros(n)
    for j in range(time.size):
        if j > 0:
            h = (time[j] - time[j - 1]) / substeps
            for s in range(substeps):
                x = (s + 0.5) / substeps
                for i in range(n):
                    now[i] = (1.0 - x) * torque[j - 1, i] + x * torque[j, i]
                midpoint_step(chain, state, base[0], base[1], 0.0, h, -1, now)
                base[0] += h * base[1]
        shift, faster = state.psi[0], state.speed[0]
        base[0] += shift
        base[1] += faster
        for i in range(n):
            state.psi[i] -= shift
            state.speed[i] -= faster
        observe(chain, state, base[0], base[1], 0.0, -1, torque[j], j, out)
        reference[j] = base[0]


@pytest.mark.slow
@pytest.mark.parametrize(("inertia", "order", "rpm"), [(1.0, 15, 448.9), (1.0, 16, 420.9), (0.3, 15, None)])
def test_a_run_up_has_its_peak_at_the_critical_speed(inertia: float, order: int, rpm: float | None) -> None:
    machine = wide(inertia, slip=20.0)
    elastic = elastic_shaft(machine)
    near = 60.0 * find_modes(elastic)[0].damped_Hz / order
    slow, fast = 0.95 * near * math.pi / 30.0, 1.05 * near * math.pi / 30.0
    found = find_resonances(elastic, (slow, fast))
    critical = next(each for each in found.critical if each.order == order)
    assert rpm is None or critical.speed_rad_s * 30.0 / math.pi == pytest.approx(rpm, rel=1e-3)
    t = np.arange(0.0, 25.0, 1e-3)
    asked = slow + (fast - slow) * t / t[-1]
    torque = np.zeros((t.size, 17))
    turn = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    load = ttc.compile(machine, ["torque_load_Nm"]).evaluate(turn, 1.0, 0.0)["torque_load_Nm"].mean()
    torque[:, 0] = 20.0 * asked + load
    state, out, theta = chain_state(elastic.chain), outputs(t.size, 17), np.zeros(t.size)
    twist_statically(elastic.chain, state, 0.0, slow, 0.0, 0, torque[0])
    run_free(elastic.chain, state, np.array([0.0, slow]), t, 8, torque, theta, out)
    speed, size = order_amplitude(t, theta, out.pieces[:, 0], order, turns=8)
    top = np.abs(speed / speed[size.argmax()] - 1.0) < 0.015
    bend, slope, _ = np.polyfit(speed[top] / critical.speed_rad_s - 1.0, size[top], 2)
    assert bend < 0.0
    assert abs(slope / (2.0 * bend)) < 0.005


def test_the_command_says_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "wide.yaml"
    path.write_text(
        "machine: tufting\nshaft: {diameter_m: 0.06, length_m: 4, stations: 16, damping_Nms_rad: 1.25,"
        " drive: {inertia_kgm2: 1.0}}\n"
    )
    outs = ["--json", str(tmp_path / "r.json"), "--png", str(tmp_path / "r.png")]
    assert main(["resonances", str(path), "--rpm", "400:500", *outs]) == 0
    printed = capsys.readouterr().out
    assert "  449.0 rpm: order 15 meets mode 1 (112.2 Hz)" in printed
    numbers = json.loads((tmp_path / "r.json").read_text())
    assert numbers["modes"][0]["undamped_Hz"] == pytest.approx(112.256, abs=1e-3)
    assert len(numbers["modes"]) == 16
    assert all(400.0 <= each["rpm"] <= 500.0 for each in numbers["critical_speeds"])
    assert (tmp_path / "r.png").stat().st_size > 20_000


def test_modes_without_damping_print_no_negative_zero(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "wide.yaml"
    path.write_text(
        "machine: tufting\nshaft: {diameter_m: 0.06, length_m: 4, stations: 16, drive: {inertia_kgm2: 1.0}}\n"
    )
    assert main(["resonances", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "0.00%" in printed and "-0.00" not in printed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["tufting"], "machine 'tufting' has a rigid shaft; give it a `shaft` with stations and pieces"),
        (["tufting", "--rpm", "500:100"], "must be two rising speeds in rpm, such as 100:600, not '500:100'"),
        (["needle_transfer"], "is no linkage"),
    ],
)
def test_the_command_refuses(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["resonances", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_an_empty_range_of_speeds_is_refused() -> None:
    with pytest.raises(MotionError, match="the range of speeds must rise"):
        find_resonances(elastic_shaft(wide()), (10.0, 10.0))
