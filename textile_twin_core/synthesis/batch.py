"""Evaluation of many designs of one machine at once, thousands of designs per second."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError, TwinError
from textile_twin_core.machine import Machine
from textile_twin_core.synthesis.design_chart import DesignChart, Turn, result_names
from textile_twin_core.synthesis.family import Family

SAMPLES = 180
_CHARTS = 16
"""Charts that are kept for the next evaluation."""


class Batch:
    """Key figures of many designs that differ from one machine in some parameters of its family.

    The machine's own closed forms are evaluated with these parameters as arrays.

    Args:
        family: the design family.
        values: parameters of the machine that differ from the family's.
        speed_rad_s: constant speed of the shaft; by default the machine's nominal one.
        dwell_within_m: distance from the rear point that counts as dwell; by default 5 % of the stroke.
        samples: shaft angles of a turn.

    Raises:
        SceneError: for a machine with a history, whose motion is no function of the shaft angle.
    """

    def __init__(
        self,
        family: Family,
        values: Mapping[str, float] | None = None,
        speed_rad_s: float | None = None,
        dwell_within_m: float | None = None,
        samples: int = SAMPLES,
    ) -> None:
        given = {name: float(value) for name, value in (values or {}).items()}
        machine = family.machine(given)
        if not isinstance(machine, Machine):
            raise SceneError(f"machine '{machine.name}' has a history: its designs are evaluated one by one")
        self.machine, self.names = machine, result_names(machine)
        speed = machine.nominal_speed_rad_s if speed_rad_s is None else speed_rad_s
        self._turn = Turn(machine.shaft_angles(samples), speed, dwell_within_m)
        self._family, self._searchable = family, frozenset(family.searchable)
        self._base = {p.name: p.value for p in family.parameters if p.value is not None} | given
        self._charts: dict[frozenset[str], list[DesignChart]] = {}

    def fixed(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return those of the parameters that select a closed form and therefore cannot vary in a batch."""
        return self._charts_of(frozenset(names))[0].fixed

    def evaluate(self, values: Mapping[str, FloatArray], names: Iterable[str]) -> dict[str, FloatArray]:
        """Compute results by name, each (n,), for values (n,) of some parameters; NaN for an impossible design.

        A design is impossible if the family refuses to build it.

        Raises:
            SceneError: for an unknown result or parameter, or a parameter of `fixed`.
        """
        names = tuple(names)
        for name in names:
            if name not in self.names:
                raise SceneError(f"there is no number '{name}'; available: {', '.join(self.names)}")
        for name in values:
            if name not in self._searchable:
                raise SceneError(f"machine '{self.machine.name}' has no number '{name}'")
        for name in self.fixed(values):
            raise SceneError(
                f"machine '{self.machine.name}': '{name}' selects a closed form, and cannot vary in a batch"
            )
        count = max((np.size(v) for v in values.values()), default=1)
        columns = {name: np.broadcast_to(np.asarray(v, dtype=np.float64), count) for name, v in values.items()}
        found = {name: np.full(count, np.nan) for name in names}
        pending, tried, charts = np.arange(count), 0, self._charts_of(frozenset(values))
        del charts[_CHARTS:]
        while pending.size:
            is_new = tried == len(charts)
            if is_new:
                try:
                    charts.append(self._chart({name: float(v[pending[0]]) for name, v in columns.items()}))
                except TwinError:
                    pending = pending[1:]
                    continue
            results, covered = charts[tried].evaluate({name: v[pending] for name, v in columns.items()}, names)
            covered[0] |= is_new  # a chart holds where it was built
            for name, result in results.items():
                found[name][pending[covered]] = result[covered]
            pending, tried = pending[~covered], tried + 1
        return found

    def _charts_of(self, varied: frozenset[str]) -> list[DesignChart]:
        if varied not in self._charts:
            self._charts[varied] = [self._chart({name: self._base.get(name, 0.0) for name in sorted(varied)})]
        return self._charts[varied]

    def _chart(self, varied: Mapping[str, float]) -> DesignChart:
        return DesignChart(self._build, {**self._base, **varied}, varied, self._turn)

    def _build(self, numbers: Mapping[str, float]) -> Machine:
        machine = self._family.machine(numbers)
        assert isinstance(machine, Machine)
        return machine
