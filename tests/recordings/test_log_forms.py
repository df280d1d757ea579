"""Logs of every form become the same samples, by a guess or by a mapping."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.generators.logs import ANGLE, FORMS, SPEED, TIME, TORQUE, Form, N
from textile_twin_core.recordings.log_apply import LoggedSamples, apply
from textile_twin_core.recordings.log_files import read_table
from textile_twin_core.recordings.log_guess import guess
from textile_twin_core.recordings.log_mapping import LogMapping, mapping_path, read_mapping, write_mapping

_EXACT = Form("").within


def wished(tmp_path: Path, form: Form) -> LogMapping:
    (tmp_path / "mine.yaml").write_text(form.mapping or "{}", encoding="utf-8")
    return read_mapping(tmp_path / "mine.yaml")


def check(samples: LoggedSamples, form: Form) -> None:
    """Compare angle, torque and speed, at their own times, with the logged ones."""
    angle, torque = samples.angle, samples.torque
    assert torque is not None and (angle.values.size, torque.values.size) == (N, N - len(form.no_torque))
    turned = np.mod(angle.values - ANGLE + math.pi, 2.0 * math.pi) - math.pi
    np.testing.assert_allclose(turned - (turned[0] if form.within != _EXACT else 0.0), 0.0, atol=form.within)
    there = np.delete(np.arange(N), form.no_torque)
    np.testing.assert_allclose(torque.values, TORQUE[there], atol=2e-6)
    np.testing.assert_allclose((angle.stamps - angle.stamps[0]) * 1e-9, TIME, atol=2e-6)
    late = (torque.stamps - angle.stamps[0]) * 1e-9 - TIME[there]
    np.testing.assert_allclose(late, form.late_s, atol=2e-6)
    assert (samples.omega is not None) == form.speed
    if samples.omega is not None:
        np.testing.assert_allclose(samples.omega, SPEED, atol=1e-6)
    if form.start:
        assert abs(int(angle.stamps[0]) - int(np.datetime64(form.start, "ns").astype(np.int64))) < 1000


@pytest.mark.parametrize("name", FORMS)
def test_the_samples_of_a_form(name: str, tmp_path: Path) -> None:
    form = FORMS[name]
    log = tmp_path / form.name
    log.write_bytes(form.text.encode() if isinstance(form.text, str) else form.text)
    mapping = wished(tmp_path, form)
    columns, head = read_table(log, text=mapping.text, signals=mapping.signals)
    complete = guess(columns, head, mapping).mapping
    samples = apply(complete, columns)
    check(samples, form)
    # The written mapping reads the next log of the kind without a guess.
    stored = mapping_path(tmp_path / "bag")
    write_mapping(stored, replace(complete, text=head.text, signals=head.long_form), log.name)
    again = read_mapping(stored)
    columns, _ = read_table(log, text=again.text, signals=again.signals)
    same = apply(again, columns)
    np.testing.assert_array_equal(same.angle.stamps, samples.angle.stamps)
    np.testing.assert_array_equal(same.angle.values, samples.angle.values)
