"""textile-twin compare: measured against predicted torque of a recording."""

from __future__ import annotations

import argparse
import dataclasses
import json
from contextlib import ExitStack
from pathlib import Path

from textile_twin_core.cli import compare_quantity
from textile_twin_core.cli.arguments import Parser, add_machine, add_recording, number, shaft_settings
from textile_twin_core.cli.mistakes import BeyondLimitError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.outputs import print_rows
from textile_twin_core.cli.places import check_output
from textile_twin_core.cli.progress import stages
from textile_twin_core.cli.readings import read_samples, readings_of
from textile_twin_core.cli.sensor_options import add_sensors, with_sensors
from textile_twin_core.comparison import Comparison, assess, compare_torque, summary_rows, verdict_lines
from textile_twin_core.files import machine_document, staged
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.prediction import recompute, recorded_torque

_LIMITS = {
    "max-rms": ("rms_error_Nm", "RMS error [N m]"),
    "max-rms-over-peak": ("rms_over_peak", "RMS error over the largest measured torque"),
    "max-error": ("max_error_Nm", "largest error [N m]"),
    "min-correlation": ("correlation", "correlation"),
}
"""Limits for scripts: the error they speak of, and its name."""

_PREDICTED, _JUDGED = 0.4, 0.7
"""Shares of all work, of an hour's recording, at which prediction and verdict end."""
_FORMS = {
    "json": "the numbers",
    "rrd": "a recording for textile-twin view",
    "png": "a plot by shaft angle",
    "html": "a report",
}


def parser() -> Parser:
    """The command's arguments."""
    parser = Parser(
        "compare",
        "Holds the measured torque of a recording against the predicted one: errors, delay, errors by shaft angle.",
        "textile-twin compare bags/tufting_160rpm_synthetic --machine tufting --png comparison.png",
    )
    add_recording(parser, shaft="smooth")
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
    for option, (_, what) in _LIMITS.items():
        parser.add_argument(
            f"--{option}", type=number, metavar="X", help=f"exit code 3 when the {what} is beyond this limit"
        )
    for form, what in _FORMS.items():
        parser.add_argument(f"--{form}", type=Path, metavar="FILE", help=f"write {what}; is replaced when it is there")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Compare, print the table, write what was asked for."""
    machine = with_sensors(load_linkage(arguments.machine, arguments.set), arguments)

    for form in _FORMS:
        check_output(f"--{form}", getattr(arguments, form), f".{form}")
    if arguments.quantity is not None:
        compare_quantity.run(arguments, machine, _LIMITS)
        return

    with ExitStack() as outputs:
        # All places are tried before the work, and take their files only when every one is written.
        partial: dict[str, Path] = {}
        for form in _FORMS:
            path = getattr(arguments, form)
            if path is not None:
                partial[form] = outputs.enter_context(staged(path))
        comparison = compare_recording(arguments, machine, arguments.predicted == "recorded")
        _write(partial, comparison, machine, arguments)
    _print(comparison)
    _check_limits(comparison, arguments)


def compare_recording(arguments: argparse.Namespace, machine: Machine, recorded: bool = False) -> Comparison:
    """The comparison that the arguments of add_recording ask for; recorded: with the predictions in the recording."""
    bag, angles, measured = read_samples(arguments, machine)
    with stages(len(angles)) as stage:
        # Smoothing the whole recording takes as long again, when its last sample is there.
        done = stage("predicting", _PREDICTED, 2 * len(angles))
        predicted = recompute(angles, machine, arguments.shaft, done, **shaft_settings(arguments))
        stage("judging", _JUDGED, 1)
        judged = assess(readings_of(angles, measured), machine, predicted.track)
        notes, verdict, explained, seen = judged.notes, judged.verdict, judged.explained, judged.quantities
        angle_topic = angles.topic
        del judged, angles  # these and the track hold the whole recording once more
        predicted = dataclasses.replace(predicted, track=None)
        if recorded:
            predicted = recorded_torque(bag, predicted, angle_topic)
        stage("comparing", 1.0, 1)
        comparison = compare_torque(
            measured.stamps,
            measured.torque_Nm,
            predicted.stamps_ns,
            predicted.torque_Nm,
            predicted.theta_rad,
            torque_sensor=machine.sensors.torque,
            events=machine.events(),
            settled=predicted.settled,
            predicted_sigma_Nm=predicted.sigma_Nm,
            rejected=predicted.rejected,
        )
    return dataclasses.replace(
        comparison,
        notes=(*comparison.notes, *predicted.notes, *notes),
        verdict=verdict,
        explained=explained,
        quantities=seen,
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

        write_comparison_recording(path, comparison, machine, title=arguments.bag.name)
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
    write_report(path, comparison, machine, title=arguments.bag.name, declaration=text, provenance=provenance)


def _check_limits(comparison: Comparison, arguments: argparse.Namespace) -> None:
    beyond = []
    for option, (field, what) in _LIMITS.items():
        limit = getattr(arguments, option.replace("-", "_"))
        value = getattr(comparison.errors, field)
        if limit is not None and not (value >= limit if option.startswith("min") else value <= limit):
            beyond.append(f"{what} {value:.6g} is beyond --{option} {limit:g}")
    if beyond:
        raise BeyondLimitError("; ".join(beyond))


def _print(comparison: Comparison) -> None:
    verdict = [("" if k else "verdict", line) for k, line in enumerate(verdict_lines(comparison))]
    print_rows([*summary_rows(comparison), *verdict])
