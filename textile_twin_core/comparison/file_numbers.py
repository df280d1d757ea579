"""Estimates of chosen numbers of a machine file from one recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from textile_twin_core.comparison.assessment import assess
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.errors import RecordingError, SceneError
from textile_twin_core.inference.posterior import Posterior
from textile_twin_core.inference.settled import settle, settled_sensors
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import write

_JUDGED = 0.8
"""Share of all work at which the verdict is ready."""
_UNKNOWN = 0.5
"""Posterior sigma, as a share of the prior's, above which the recording does not determine a number."""


@dataclass(frozen=True)
class FileNumbers:
    """Numbers of a machine file, estimated from a recording.

    Attributes:
        parameters: by path, given the tolerances of all other numbers.
        given_file: by path, given that all other numbers of the file are exactly right.
        nominal: by path, the file's values. unit: by path.
        not_identifiable: paths that this recording does not determine.
        machine: the machine with the estimated values.
        notes: remarks on the recording.
    """

    parameters: Mapping[str, Estimate]
    given_file: Mapping[str, Estimate]
    nominal: Mapping[str, float]
    unit: Mapping[str, str]
    not_identifiable: tuple[str, ...]
    machine: Machine
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """One object of plain lists and numbers."""
        out: dict[str, Any] = plain(
            {
                "parameters": {name: dataclasses.asdict(each) for name, each in self.parameters.items()},
                "given_file": {name: dataclasses.asdict(each) for name, each in self.given_file.items()},
                "nominal": dict(self.nominal),
                "not_identifiable": list(self.not_identifiable),
                "notes": list(self.notes),
            }
        )
        return out


def identify_numbers(readings: Readings, machine: Machine, paths: Sequence[str], begin: Begin = unheard) -> FileNumbers:
    """Estimate numbers of the machine file, together with the sensors and friction that the recording determines.

    Args:
        readings: The recording.
        machine: The machine of the file.
        paths: Paths into the machine file, such as `bodies.l3.mass_kg`.
        begin: Called at each stage.

    Raises:
        SceneError: A path is no number on which the torque depends.
        RecordingError: The recording determines nothing, or is of another machine.
    """
    begin("judging", _JUDGED)
    assessment = assess(readings, machine)
    begin("settling", 1.0)
    if assessment.found is None:
        raise RecordingError("; ".join(assessment.notes))
    for cause in assessment.verdict:
        if cause.cause == "other_machine":
            raise RecordingError(f"nothing to identify: {cause.text}")
    posterior = assessment.found.posterior
    _check(posterior, machine, paths)
    # Besides the paths only sensors and friction stay free; the file's other numbers count as known.
    free = settled_sensors(posterior, assessment.found.evidence.turns_in_both_directions()) - set(
        _file_numbers(posterior)
    )
    settled = settle(posterior, free | set(paths))
    tolerant, exact = {}, {}
    for path in paths:
        low, high = settled.interval95(path)
        tolerant[path] = Estimate(settled.value(path), settled.sigma(path), (low, high))
        value, sigma = settled.given_file(path)
        exact[path] = Estimate.normal(value, sigma)
    known = {path: posterior.parameter(path) for path in paths}
    lost = tuple(path for path in paths if tolerant[path].sigma > _UNKNOWN * known[path].departure)
    values = {posterior.measurement.model.slot_name(path): tolerant[path].value for path in paths if path not in lost}
    written = write(machine, values)
    assert isinstance(written, Machine)
    return FileNumbers(
        parameters={path: each for path, each in tolerant.items() if path not in lost},
        given_file={path: each for path, each in exact.items() if path not in lost},
        nominal={path: known[path].nominal for path in paths},
        unit={path: known[path].unit for path in paths},
        not_identifiable=lost,
        machine=written,
        notes=assessment.notes,
    )


def _file_numbers(posterior: Posterior) -> list[str]:
    return [p.name for p in posterior.measurement.model.in_file]


def _check(posterior: Posterior, machine: Machine, paths: Sequence[str]) -> None:
    """Raise SceneError for a path that is no number of the file."""
    names = _file_numbers(posterior)
    for path in paths:
        if path not in names:
            near = get_close_matches(path, names, n=3) or names[:6]
            raise SceneError(
                f"machine '{machine.name}': the torque depends on no number '{path}' of its file; did you mean"
                f" {' or '.join(near)}?"
            )
