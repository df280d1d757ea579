"""Session of one tab of the page: design, history, and an answer to every message."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cache
from threading import Event
from typing import Any

from textile_twin_core import machines
from textile_twin_core.errors import SceneError, TwinError
from textile_twin_core.explore.analysis import analyse
from textile_twin_core.explore.balancing import balanced
from textile_twin_core.explore.design import Design, check_number
from textile_twin_core.explore.exports import as_csv, as_dxf, as_picture, design_text, machine_text, read_design
from textile_twin_core.explore.first_look import NotYetCompiledError, await_first_look, first_look
from textile_twin_core.explore.history import History
from textile_twin_core.explore.labels import label, shown_unit
from textile_twin_core.explore.overlay import Overlay
from textile_twin_core.explore.packing import (
    Arrays,
    analysis_head,
    curve_heads,
    design_head,
    printed_of,
    progress_message,
)
from textile_twin_core.explore.search import FrontDesign, Goal, OneByOne, Task, many_designs, search
from textile_twin_core.explore.shown import Analysis
from textile_twin_core.machine import ContactMachine
from textile_twin_core.synthesis.tolerance import Limit, monte_carlo, sensitivities

Message = Mapping[str, Any]
_MOST_SECONDS = 600.0
_FEW = 400
"""Number of random machines for the tolerances if they are evaluated one by one."""


@dataclass(frozen=True)
class File:
    """File that the page offers for download."""

    name: str
    kind: str
    content: bytes


class PageSession:
    """State of one tab. Every public method answers with a message; mistakes of the user raise TwinError."""

    def __init__(self, design: Design, recording: Overlay | None = None) -> None:
        self._history = History(design)
        self._pinned: Design | None = None
        self._pinned_seen: tuple[Design, Analysis] | None = None
        self._task: dict[str, Any] = {}
        self._recording = recording
        self._front: tuple[FrontDesign, ...] = ()
        self._stop = Event()
        self._seen: tuple[Design, Analysis] | None = None

    def copy(self) -> PageSession:
        """Return another session with the present design."""
        return PageSession(self.design, self._recording)

    @property
    def design(self) -> Design:
        """Present design."""
        return self._history.present

    def answer(self, message: Message) -> bytes:
        """Answer a message.

        Raises:
            TwinError: The message is not valid.
        """
        act = _ACTS.get(str(message.get("type")))
        if act is None:
            raise SceneError(f"the page does not know '{message.get('type')}'")
        return act(self, message)

    def state(self, said: str = "", loaded: bool = False) -> bytes:
        """Describe the present design with its analysis, and the pinned design; an invalid design gives the
        reason instead.
        """
        begin, arrays = time.perf_counter(), Arrays()
        head: dict[str, Any] = {
            "type": "state",
            "design": design_head(self.design),
            "can_undo": self._history.can_undo,
            "can_redo": self._history.can_redo,
            "machines": machines.NAMES,
            "task": self._task if loaded else None,
            "said": said,
            "analysis": None,
            "pinned": None,
            "problem": "",
            "compiling_s": None,
        }
        try:
            head["analysis"] = analysis_head(self.analysis(), arrays, printed_of(self.design))
            head["curves"] = curve_heads(self.design, self.analysis(), arrays)
        except NotYetCompiledError as wait:
            head["compiling_s"] = time.monotonic() - wait.begun
        except TwinError as error:
            head["problem"] = str(error)
        if self._pinned is not None:
            if self._pinned_seen is None or self._pinned_seen[0] is not self._pinned:
                self._pinned_seen = self._pinned, analyse(self._pinned)
            head["pinned"] = analysis_head(self._pinned_seen[1], arrays, {})
        if self._recording is not None:
            r = self._recording
            if head["analysis"]:
                head["analysis"]["notes"] += [f"Recording: {note}." for note in r.notes]
            head["recording"] = {"name": r.name, "theta": arrays.add(r.theta_rad), "torque": arrays.add(r.torque_Nm)}
        head["took_ms"] = 1e3 * (time.perf_counter() - begin)
        return arrays.packed(head)

    def analysis(self) -> Analysis:
        """Analyse the present design.

        Raises:
            MachineError: The machine cannot close.
            NotYetCompiledError: The loops are still being compiled.
        """
        if self._seen is None or self._seen[0] is not self.design:
            if self.design.family.base.has_history:
                await_first_look()
            self._seen = self.design, analyse(self.design)
        return self._seen[1]

    @property
    def awaited(self) -> Future[None] | None:
        """Future of the first compilation if the present design waits for it; None otherwise."""
        if not self.design.family.base.has_history:
            return None
        run, _ = first_look()
        return None if run.done() else run

    def _hello(self, message: Message) -> bytes:
        return self.state()

    def _change(self, message: Message) -> bytes:
        given, factors = message.get("values"), {p.name: shown_unit(p.unit)[1] for p in self.design.family.parameters}
        if not isinstance(given, dict):
            raise SceneError("values: must be an object")
        values = {}
        for name, value in given.items():
            check_number(value, name)
            values[str(name)] = value / factors.get(name, 1.0)
        self._history.put(self.design.changed(values), message.get("gesture"))
        return self.state()

    def _curve(self, message: Message) -> bytes:
        ways = message.get("ways")
        if not isinstance(ways, dict) or not all(isinstance(way, list) for way in ways.values()) or "in" not in ways:
            raise SceneError("ways: must be an object with the forces 'in', and 'out' where they differ, as lists")
        design = self.design.with_curve(str(message.get("name")), ways["in"], ways.get("out"))
        self._history.put(design, message.get("gesture"))
        return self.state()

    def _speed(self, message: Message) -> bytes:
        check_number(message.get("rpm"), "speed")
        self._history.put(self.design.at_speed(message["rpm"] * math.pi / 30.0), message.get("gesture"))
        return self.state()

    def _dwell(self, message: Message) -> bytes:
        within = message.get("mm")
        if within is not None:
            check_number(within, "dwell within")
            within = within / 1e3
        self._history.put(self.design.dwelling_within(within))
        return self.state()

    def _undo(self, message: Message) -> bytes:
        self._history.undo()
        return self.state()

    def _redo(self, message: Message) -> bytes:
        self._history.redo()
        return self.state()

    def _reset(self, message: Message) -> bytes:
        self._history.put(self.design.fresh())
        return self.state()

    def _machine(self, message: Message) -> bytes:
        self._history.put(_published(str(message.get("name"))))
        self._clear_results()
        return self.state()

    def _load(self, message: Message) -> bytes:
        design, self._task = read_design(str(message.get("text", "")), str(message.get("name") or "the file"))
        self._history.put(design)
        self._clear_results()
        return self.state(f"Loaded {message.get('name')}.", loaded=True)

    def _clear_results(self) -> None:
        """Clear everything that belongs to another machine."""
        self._front, self._recording = (), None
        if self._pinned is not None and _measured(self._pinned) != _measured(self.design):
            self._pinned = None

    def _pin(self, message: Message) -> bytes:
        if message.get("on"):
            self._pinned_seen = self.design, self.analysis()
            self._pinned = self.design
        else:
            self._pinned = None
        return self.state()

    def _balance(self, message: Message) -> bytes:
        before = self.design
        ripple = message.get("ripple")
        design, said = balanced(before, str(message.get("way")), 0.02 if ripple is None else _number(ripple, "ripple"))
        self._history.put(design)
        self._pinned = before
        return self.state(said)

    def _pick(self, message: Message) -> bytes:
        place = message.get("index")
        if not isinstance(place, int) or not 0 <= place < len(self._front):
            raise SceneError("that design is no longer there; search again")
        self._history.put(self.design.changed(self._front[place].values))
        return self.state()

    def _sensitivity(self, message: Message) -> bytes:
        names, parameters = self._asked(message)
        batch = many_designs(self.design, parameters)
        known = [name for name in names if name in batch.names]
        found = sensitivities(self.design.family, self.design.values, batch, known, parameters)
        units = {p.name: p.unit for p in self.design.family.parameters}
        texts = {p.name: p.text for p in self.design.family.parameters}
        rows = []
        for parameter in parameters:
            step, words = _small_step(units[parameter], self.design.value(parameter) or 0.0)
            cells = [found[name][parameter] * step * label(name).factor for name in known]
            rows.append({"parameter": parameter, "text": texts[parameter], "step": words, "changes": cells})
        heads = [{"text": label(name).text, "unit": label(name).unit} for name in known]
        return Arrays().packed({"type": "sensitivities", "numbers": heads, "rows": rows})

    def _tolerance(self, message: Message) -> bytes:
        _, parameters = self._asked(message)
        task, width = self.task(message), _number(message.get("width"), "tolerance")
        units = {p.name: p.unit for p in self.design.family.parameters}
        tolerances = {p: width / shown_unit(units[p])[1] for p in parameters if units[p] in ("m", "rad")}
        if not tolerances:
            raise SceneError("choose at least one length or angle as free: those have tolerances")
        batch = many_designs(self.design, tolerances)
        size = {"samples": _FEW, "corners": _FEW} if isinstance(batch, OneByOne) else {}
        found = monte_carlo(
            self.design.family, self.design.values, batch, batch.names, tolerances, task.limits, **size, seed=task.seed
        )
        rows = []
        for name, spread in found.spreads.items():
            words = label(name)
            rows.append(
                {"text": words.text, "unit": words.unit, **{k: v * words.factor for k, v in vars(spread).items()}}
            )
        return Arrays().packed(
            {
                "type": "tolerances",
                "rows": rows,
                "scrap": found.scrap_rate,
                "limits": [
                    {"text": label(k.number).text, "scrap": s}
                    for k, s in zip(task.limits, found.scrap_by_limit, strict=True)
                ],
                "samples": found.samples,
                "parameters": list(tolerances),
            }
        )

    def _asked(self, message: Message) -> tuple[list[str], list[str]]:
        """Return the numbers of the present design and its free parameters."""
        searchable = self.design.family.searchable
        free = [name for name in _object(message, "free") if name in searchable]
        lengths = [p.name for p in self.design.family.parameters if p.unit == "m" and p.name in searchable]
        return list(self.analysis().numbers), free or lengths

    def task(self, message: Message) -> Task:
        """Read the task from a message in the units of the page.

        Raises:
            SceneError: The message describes no valid task.
        """
        free = {}
        factors = {p.name: shown_unit(p.unit)[1] for p in self.design.family.parameters}
        for name, ends in _object(message, "free").items():
            if not isinstance(ends, (list, tuple)) or len(ends) != 2:
                raise SceneError(f"range of '{name}': give two numbers")
            for end in ends:
                check_number(end, f"range of '{name}'")
            free[str(name)] = (ends[0] / factors.get(name, 1.0), ends[1] / factors.get(name, 1.0))
        goals = tuple(Goal(_of_number(g, "goals"), g.get("sense") == "max") for g in _objects(message, "goals"))
        limits = []
        for given in _objects(message, "limits"):
            check_number(given.get("value"), "limit")
            number = _of_number(given, "limits")
            limits.append(Limit(number, given.get("sense") == ">=", given["value"] / label(number).factor))
        seed = message.get("seed") or 0
        check_number(seed, "seed")
        self._task = {k: message.get(k) for k in ("free", "goals", "limits", "seed")}
        return Task(free, goals, tuple(limits), abs(int(seed)))

    def search(self, message: Message, report: Callable[[bytes], None]) -> bytes:
        """Search as the message requests; call `report` with messages meanwhile, and return the last message."""
        task, design = self.task(message), self.design
        seconds = message.get("seconds") or 60.0
        check_number(seconds, "seconds")
        self._stop.clear()
        begin = time.monotonic()
        done = search(
            design,
            task,
            lambda progress: report(progress_message(progress, task, running=True)),
            self._stop.is_set,
            min(float(seconds), _MOST_SECONDS),
        )
        self._front = done.front
        return progress_message(done, task, running=False, took=time.monotonic() - begin)

    def stop(self) -> None:
        """Stop a search after its present generation."""
        self._stop.set()

    def file(self, kind: str, angle_rad: float) -> File:
        """Return the design as a file of a kind.

        Raises:
            SceneError: The kind or the angle is not valid.
            MachineError: The design gives no valid machine.
        """
        check_number(angle_rad, "angle")
        name = self.design.family.name
        match kind:
            case "yaml":
                return File(f"{name}.yaml", "application/yaml", machine_text(self.design).encode())
            case "json":
                return File(f"{name}_design.json", "application/json", design_text(self.design, self._task).encode())
            case "csv":
                return File(f"{name}.csv", "text/csv", as_csv(self.analysis()).encode())
            case "dxf":
                return File(f"{name}.dxf", "image/vnd.dxf", as_dxf(self.analysis(), angle_rad).encode())
            case "png" | "svg":
                kinds = {"png": "image/png", "svg": "image/svg+xml"}
                return File(f"{name}.{kind}", kinds[kind], as_picture(self.analysis(), name, angle_rad, kind))
            case _:
                raise SceneError(f"there is no file of kind '{kind}'")


@cache
def _published(name: str) -> Design:
    """Return a published machine, shared by all tabs and all steps of their histories."""
    return Design.of(machines.create(name))


def _measured(design: Design) -> tuple[str, ...]:
    """Return the names of the measures of a machine."""
    base = design.family.base
    return base.elements if isinstance(base, ContactMachine) else tuple(m.name for m in getattr(base, "measures", ()))


def _object(message: Message, what: str) -> Mapping[str, Any]:
    """Return an object of a message by name; empty if missing."""
    value = message.get(what) or {}
    if not isinstance(value, dict):
        raise SceneError(f"{what}: must be an object, not {value!r:.40}")
    return value


def _objects(message: Message, what: str) -> list[Mapping[str, Any]]:
    value = message.get(what) or []
    if not isinstance(value, list) or not all(isinstance(each, dict) for each in value):
        raise SceneError(f"{what}: must be a list of objects, not {value!r:.40}")
    return value


def _of_number(given: Mapping[str, Any], what: str) -> str:
    """Return the name of the number in a goal or limit."""
    if not isinstance(given.get("number"), str):
        raise SceneError(f"{what}: each needs a 'number', the name of one")
    return str(given["number"])


def _number(value: object, what: str) -> float:
    check_number(value, what)
    return float(value)  # type: ignore[arg-type]


def _small_step(unit: str, value: float) -> tuple[float, str]:
    """Return a typical small error of a parameter (SI), and its text."""
    if unit == "m":
        return 1e-4, "0.1 mm"
    if unit == "rad":
        return math.radians(0.1), "0.1 deg"
    return 0.01 * abs(value), "1 %"


_ACTS: dict[str, Callable[[PageSession, Message], bytes]] = {
    "hello": PageSession._hello,
    "change": PageSession._change,
    "curve": PageSession._curve,
    "speed": PageSession._speed,
    "dwell": PageSession._dwell,
    "undo": PageSession._undo,
    "redo": PageSession._redo,
    "reset": PageSession._reset,
    "machine": PageSession._machine,
    "load": PageSession._load,
    "pin": PageSession._pin,
    "balance": PageSession._balance,
    "pick": PageSession._pick,
    "sensitivity": PageSession._sensitivity,
    "tolerance": PageSession._tolerance,
}
