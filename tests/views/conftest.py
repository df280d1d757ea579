"""Comparison of a simulated run of the tufting machine, shared by the tests of the views."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun.chunk

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison import Comparison, compare_torque
from textile_twin_core.comparison.uncertainty import Estimate

START_NS = 1_763_000_000_000_000_000


@dataclass(frozen=True)
class Run:
    """Inputs of the comparison, and the comparison."""

    machine: ttc.Machine
    stamps_ns: IntArray
    theta_rad: FloatArray
    predicted_Nm: FloatArray
    sigma_Nm: FloatArray
    measured_ns: IntArray
    measured_Nm: FloatArray
    comparison: Comparison


def make_run(seconds: float = 6.0) -> Run:
    """Simulate a run-up to 160 rpm in a second, with a sensor delay of 2 ms and a disturbance of 2.5 N m in one
    turn.
    """
    rng = np.random.default_rng(11)
    machine = ttc.machines.tufting(torque_sensor_delay_s=0.0, torque_sensor_gain=1.01)
    n = int(500 * seconds)
    time = np.arange(n, dtype=np.float64) * 2e-3
    speed = 2 * np.pi * 160 / 60

    def angle(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        theta = speed * np.where(t < 1.0, t**2 / 2, t - 0.5)
        return np.asarray(theta), np.asarray(speed * np.clip(t, 0, 1)), np.where(t < 1.0, speed, 0.0)

    twin = ttc.compile(machine, outputs=["balancing_torque_Nm"], method="exact")
    predicted = np.asarray(twin.evaluate(*angle(time))["balancing_torque_Nm"])
    lagged = angle(np.asarray(np.maximum(time - 0.002, 0.0)))
    measured = 1.01 * np.asarray(twin.evaluate(*lagged)["balancing_torque_Nm"]) + rng.normal(0, 0.1, n)
    knock = (np.floor(lagged[0] / (2 * np.pi)) == 9) & (np.abs(np.mod(lagged[0], 2 * np.pi) - 1.0) < 0.1)
    measured += 2.5 * knock
    stamps = START_NS + np.round(time * 1e9).astype(np.int64)
    sigma = np.full(n, 0.05)
    comparison = compare_torque(
        stamps,
        measured,
        stamps,
        predicted,
        angle(time)[0],
        torque_sensor=machine.sensors.torque,
        delay=Estimate(0.002, 1e-5),
        events=machine.events(),
        settled=time > 0.5,
        predicted_sigma_Nm=sigma,
    )
    return Run(machine, stamps, angle(time)[0], predicted, sigma, stamps, measured, comparison)


@pytest.fixture(scope="session")
def run() -> Run:
    return make_run()


@pytest.fixture(scope="session", autouse=True)
def own_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Give the viewer a temporary home, since it writes settings at its first use."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
        yield


def rows_of(path: Path, entity: str, component: str) -> tuple[FloatArray, list[list[Any]]]:
    """Return the times [s] and values of one component in a recording, in order of time; static rows have no time."""
    found: list[tuple[float, list[Any]]] = []
    for chunk in rerun.chunk.RrdReader(str(path)).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        if component not in batch.schema.names:
            continue
        values = batch.column(component).to_pylist()
        named = "time" in batch.schema.names
        times = batch.column("time").cast("int64").to_pylist() if named else [None] * len(values)
        found += [(np.nan if at is None else at * 1e-9, value) for at, value in zip(times, values, strict=True)]
    found.sort(key=lambda row: row[0])
    return np.array([at for at, _ in found]), [value for _, value in found]


def scalars_of(path: Path, entity: str, component: str = "Scalars:scalars") -> tuple[FloatArray, FloatArray]:
    """Return the times [s] and numbers of a component that holds one number per row."""
    times, values = rows_of(path, entity, component)
    return times, np.array([value[0] for value in values], dtype=np.float64)
