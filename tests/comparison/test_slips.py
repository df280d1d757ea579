"""Slips of the encoder: detected where speed and angle disagree; whole turns of the encoder are removed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack
from textile_twin_core.comparison.slips import slips_of, without_turns

TIME = np.arange(0.0, 10.0, 0.01)
THETA = 14.0 * TIME + 0.3 * np.sin(3.0 * TIME)
TRACK = ShaftTrack(TIME, THETA, 14.0 + 0.9 * np.cos(3.0 * TIME), -2.7 * np.sin(3.0 * TIME), 0.05, slips=1)


def test_a_slip_is_found_where_it_is() -> None:
    slips = slips_of(replace(TRACK, theta_rad=THETA + 0.3 * (TIME > 4.005)))
    assert np.flatnonzero(slips).tolist() == [400]
    assert slips[400] == pytest.approx(0.3, abs=1e-3)
    assert not slips_of(TRACK).any()


def test_a_step_over_a_gap_is_no_slip() -> None:
    kept = (TIME < 3.0) | (TIME > 4.0)
    parts = (TRACK.theta_rad + 1.0 * (TIME > 3.5), TRACK.omega_rad_s, TRACK.alpha_rad_s2)
    track = ShaftTrack(TIME[kept], *(part[kept] for part in parts), 0.05, slips=1)
    assert not slips_of(track).any()


@pytest.mark.parametrize("turn", [TURN, 0.5 * TURN])
def test_whole_turns_of_the_encoder_are_removed(turn: float) -> None:
    anew = replace(TRACK, theta_rad=np.remainder(THETA, turn))
    assert np.allclose(without_turns(anew, turn).theta_rad, THETA, atol=1e-9)
    slipped = replace(TRACK, theta_rad=THETA + 1.0 * (TIME > 4.005))
    assert without_turns(slipped, turn) is slipped
