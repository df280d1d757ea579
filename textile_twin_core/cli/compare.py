"""textile-twin compare: measured against predicted torque of a recording."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from textile_twin_core.cli.arguments import Parser, add_machine, add_recording, number, shaft_settings
from textile_twin_core.cli.mistakes import BeyondLimitError, UsageError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.outputs import check_outputs, print_rows
from textile_twin_core.cli.progress import stages
from textile_twin_core.cli.readings import read_samples, read_second, readings_of, station_angles
from textile_twin_core.cli.recording_batch import BatchJob, add_batch, one_recording, quietly, run_batch
from textile_twin_core.cli.sensor_options import add_sensors, with_sensors
from textile_twin_core.comparison import Comparison, assess, compare_torque, summary_rows, verdict_lines
from textile_twin_core.files import machine_document, staged
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.prediction import recompute, recorded_torque

_LIMITS = {
    "max-rms": ("rms_error_Nm", "RMS error [N m]", "above"),
    "max-rms-over-peak": ("rms_over_peak", "RMS error over the largest measured torque", "above"),
    "max-error": ("max_error_Nm", "largest error [N m]", "above"),
    "min-correlation": ("correlation", "correlation", "below"),
}
"""Limits for scripts: the error that each limits, its name, and the side that ends with exit code 3."""

_PREDICTED, _JUDGED = 0.4, 0.7
"""Shares of all work, of an hour's recording, at which prediction and verdict end."""
_FORMS = {
    "json": "the numbers",
    "rrd": "a recording for textile-twin view",
    "png": "a plot by shaft angle",
    "html": "a report",
}


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "compare",
        "Holds the measured torque of a recording against the predicted one: errors, delay, errors by shaft angle.",
        "textile-twin compare bags/tufting_160rpm_synthetic --machine tufting --png comparison.png",
    )
    add_recording(parser, shaft="smooth", several=True)
    add_machine(parser, option=True)
    add_sensors(parser)
    parser.add_argument(
        "--predicted",
        choices=["recomputed", "recorded"],
        default="recomputed",
        help="predict from the recorded shaft angles, or take what the twin published into the recording;"
        " default %(default)s",
    )
    parser.add_argument(
        "--quantity",
        metavar="OUTPUT",
        help="hold another measured quantity against this output of the machine instead of the torque, such as"
        " sley_position_m (see textile-twin import --quantity); 'speed': the shaft's speed against what the measured"
        " torque drives",
    )
    for option, (_, what, side) in _LIMITS.items():
        parser.add_argument(f"--{option}", type=number, metavar="X", help=f"exit code 3 when the {what} is {side} it")
    for form, what in _FORMS.items():
        parser.add_argument(f"--{form}", type=Path, metavar="FILE", help=f"write {what}; overwritten if it exists")
    add_batch(parser)
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Compare, print the table and write the outputs."""
    machine = with_sensors(load_linkage(arguments.machine, arguments.set), arguments)

    if not one_recording(arguments):
        for option in ("quantity", "rrd", "png", "html"):
            if getattr(arguments, option) is not None:
                raise UsageError(f"--{option} is for one recording; of several give --parquet or --json")
        run_batch(arguments, machine, comparing, _line, lambda numbers: _beyond(numbers["torque"], arguments))
        return
    check_outputs(arguments)
    if arguments.quantity is not None:
        from textile_twin_core.cli import compare_quantity

        compare_quantity.run(arguments, machine, _LIMITS)
        return

    with ExitStack() as outputs:
        # All outputs are opened before the work, and replace existing files only when all are written.
        partial: dict[str, Path] = {}
        for form in _FORMS:
            path = getattr(arguments, form)
            if path is not None:
                partial[form] = outputs.enter_context(staged(path))
        comparison = compare_recording(arguments, machine, arguments.predicted == "recorded")
        _write(partial, comparison, machine, arguments)
    _print(comparison)
    _check_limits(comparison, arguments)


def comparing(job: BatchJob) -> dict[str, Any]:
    """Compare one recording of several; return the numbers of --json."""

    def work(arguments: argparse.Namespace, machine: Machine) -> dict[str, Any]:
        numbers = compare_recording(arguments, machine, arguments.predicted == "recorded").to_json()
        # A column has one type; text values are in the text of the verdict.
        for cause in numbers["verdict"]:
            cause["value"] = cause["value"] if isinstance(cause["value"], int | float) else None
        return numbers

    return quietly(job, work)


def compare_recording(arguments: argparse.Namespace, machine: Machine, recorded: bool = False) -> Comparison:
    """Compare the recording of the arguments of add_recording; `recorded`: with the predictions in the recording."""
    bag, angles, measured = read_samples(arguments, machine)
    second = read_second(arguments, machine, bag)
    with stages(len(angles)) as stage:
        # Smoothing the whole recording takes the same time again, after its last sample.
        done = stage("predicting", _PREDICTED, 2 * len(angles))
        predicted = recompute(angles, machine, arguments.shaft, done, second, **shaft_settings(arguments))
        readings = readings_of(angles, measured, second)
        share = _JUDGED - _PREDICTED
        stage("judging", _PREDICTED if machine.shaft is not None else _JUDGED, 1)
        judged = assess(
            readings, machine, predicted.track, lambda what, until: stage(what, _PREDICTED + until * share, 1)
        )
        notes, verdict, explained, seen = judged.notes, judged.verdict, judged.explained, judged.quantities
        delay = judged.delay
        curves = {} if judged.law is None else {judged.law.key: judged.law.curve}
        times = None if angles.timing is None or angles.recorded_ns is None else (angles.recorded_ns, angles.stamps)
        angle_topic = angles.topic
        del judged, readings, angles  # these and the track are another copy of the whole recording
        predicted = dataclasses.replace(predicted, track=None)
        if recorded:
            predicted = recorded_torque(bag, predicted, angle_topic, times)
        stage("comparing", 1.0, 1)
        comparison = compare_torque(
            measured.stamps,
            measured.torque_Nm,
            predicted.stamps_ns,
            predicted.torque_Nm,
            predicted.theta_rad,
            torque_sensor=machine.sensors.torque,
            delay=delay,
            events=machine.events(),
            settled=predicted.settled,
            predicted_sigma_Nm=predicted.sigma_Nm,
            rejected=predicted.rejected,
        )
    return dataclasses.replace(
        comparison,
        notes=(*predicted.notes, *notes),
        verdict=verdict,
        explained=explained,
        quantities=seen,
        curves=curves,
    )


def _write(partial: dict[str, Path], comparison: Comparison, machine: Machine, arguments: argparse.Namespace) -> None:
    with stages(comparison.stamps_ns.size if partial else 0) as stage:
        done = stage("writing", 1.0, len(partial))
        for form, path in partial.items():
            _write_form(form, path, comparison, machine, arguments)
            if done is not None:
                done(1)


def _write_form(form: str, path: Path, comparison: Comparison, machine: Machine, arguments: argparse.Namespace) -> None:
    if form == "json":
        about = {
            "bag": str(arguments.bag),
            "machine": machine.name,
            "predicted": arguments.predicted,
            "shaft": arguments.shaft,
        }
        text = json.dumps({**about, **comparison.to_json()}, indent=1, allow_nan=False)
        path.write_text(text + "\n", encoding="utf-8")
    elif form == "rrd":
        from textile_twin_core.views import write_comparison_recording

        stations = station_angles(arguments, machine)
        write_comparison_recording(path, comparison, machine, title=arguments.bag.name, stations=stations)
    elif form == "html":
        _write_report(path, comparison, machine, arguments)
    else:
        from textile_twin_core.views import plot_comparison

        plot_comparison(path, comparison, machine)


def _write_report(path: Path, comparison: Comparison, machine: Machine, arguments: argparse.Namespace) -> None:
    import yaml

    from textile_twin_core.views import write_report

    text = yaml.safe_dump(machine_document(machine), sort_keys=False, default_flow_style=None, width=100)
    provenance = {
        "recording": str(arguments.bag.resolve()),
        "machine": arguments.machine,
        "predictions": arguments.predicted,
        "shaft estimator": arguments.shaft,
    }
    title = f"{machine.name}: {arguments.bag if arguments.bag.name else arguments.bag.resolve()}"
    write_report(path, comparison, machine, title=title, declaration=text, provenance=provenance)


def _check_limits(comparison: Comparison, arguments: argparse.Namespace) -> None:
    if beyond := _beyond(dataclasses.asdict(comparison.errors), arguments):
        raise BeyondLimitError(beyond)


def _beyond(errors: Mapping[str, Any], arguments: argparse.Namespace) -> str:
    """Describe the exceeded limits; empty without any."""
    beyond = []
    for option, (field, what, side) in _LIMITS.items():
        limit = getattr(arguments, option.replace("-", "_"))
        value = math.nan if errors[field] is None else errors[field]
        if limit is not None and not (value >= limit if side == "below" else value <= limit):
            beyond.append(f"{what} {value:.6g} is {side} --{option} {limit:g}")
    return "; ".join(beyond)


def _line(numbers: Mapping[str, Any]) -> str:
    """Format the numbers of one recording of several in a line."""
    torque, verdict = numbers["torque"], numbers["verdict"]
    causes = ", ".join(cause["cause"] for cause in verdict) or "nothing found"
    share = math.nan if torque["rms_over_peak"] is None else torque["rms_over_peak"] * 100.0
    return (
        f"RMS error {torque['rms_error_Nm']:.4g} N m, {share:.2f} % of the peak, over {numbers['revolutions']:.0f}"
        f" turns; verdict: {causes}"
    )


def _print(comparison: Comparison) -> None:
    verdict = [("" if k else "verdict", line) for k, line in enumerate(verdict_lines(comparison))]
    print_rows([*summary_rows(comparison), *verdict])
