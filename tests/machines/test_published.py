"""Every printed number to its last digit, or an independent value and a reason for a misprint.

The independent values were computed from the printed lengths and masses without this package.
"""

from __future__ import annotations

import pytest

from textile_twin_core.papers.beatup import elliptic_gear_rows, handloom_rows
from textile_twin_core.papers.needle_transfer import needle_transfer_rows
from textile_twin_core.papers.rows import PublishedRow
from textile_twin_core.papers.tufting import tufting_rows

READINGS = {"Pad at 94.9 mm": "A", "Pad at 98.9 mm": "B"}
"""Both readings of the needle transfer's pad by a letter before their quantities."""
Rows = list[tuple[str, PublishedRow]]

# quantity: printed number, computed value, and its last digit
AGREE: dict[str, tuple[float, float, float]] = {
    "t2, smallest": (101.7, 101.7089, 1e-4),
    "t2, largest": (114.3, 114.2518, 1e-4),
    "t3, smallest": (184.3, 184.3222, 1e-4),
    "t3, largest": (199.4, 199.3870, 1e-4),
    "t4, largest": (7.38, 7.3870, 1e-4),
    "t5, smallest": (257.9, 257.9753, 1e-4),
    "t5, largest": (258.5, 258.5218, 1e-4),
    "needle stabs the backing": (22, 21.9512, 1e-4),
    "needle leaves the backing": (194, 193.9262, 1e-4),
    "needle stabs the backing, Fig. 9": (14.02, 14.0 + 21.9512 / 960, 1e-6),
    "needle lowest, Fig. 9": (14.11, 14.0 + 106.9765 / 960, 1e-6),
    "needle leaves the backing, Fig. 9": (14.20, 14.0 + 193.9262 / 960, 1e-6),
    "needle highest, Fig. 9": (14.30, 14.0 + 288.2305 / 960, 1e-6),
    "one turn of the main shaft": (0.375, 0.375, 1e-12),
    "swing of the beater": (30, 29.979, 1e-3),
    "largest acceleration of the beater": (25, 25.43, 1e-2),
    "mass of DC": (0.129, 7210 * 0.0597 * 3e-4, 1e-12),
    "mass of CB": (0.434, 7210 * 0.2007 * 3e-4, 1e-12),
    "mass of AE": (0.649, 7210 * 0.3001 * 3e-4, 1e-12),
    "inertia of CB": (0.0015, 7210 * 0.2007 * 3e-4 * (0.2007**2 + 0.03**2) / 12, 1e-12),
    "inertia of AE": (0.0049, 7210 * 0.3001 * 3e-4 * (0.3001**2 + 0.03**2) / 12, 1e-12),
    "largest displacement of the sley": (85, 84.991, 1e-3),
    "A end of the motion of element 1": (32.6, 32.6, 1e-12),
    "A original: largest acceleration of 2": (16.1, 16.04, 1e-2),
    "A optimised: pad reached": (17.96, 17.95, 1e-2),
    "B original: largest acceleration of 2": (16.1, 16.08, 1e-2),
    "B optimised: elements 2 and 3 meet": (19.23, 19.23, 1e-2),
}

DIFFER: dict[str, tuple[float, float, float, str]] = {
    "t4, smallest": (-7.89, -7.6778, 1e-4, "misprint"),
    "needle lowest": (108, 106.9765, 1e-4, "500 Hz"),
    "needle highest": (287, 288.2305, 1e-4, "500 Hz"),
    "inertia of DC": (4.073e-5, 4.80e-5, 1e-7, "15 mm"),
    "acceleration of the sley at beat-up, 300 rpm": (615.8434, 610.82, 1e-2, "not reproduced"),
    "start of the dwell at the rear": (92, 91, 0.5, "7 mm"),
    "end of the dwell at the rear": (285, 291, 0.5, "7 mm"),
    "Eq. 23: acceleration of l2, largest": (39.01, 4.4911, 1e-4, "l1 w1^2"),
    "Eq. 33: acceleration of l4 to C, largest": (0.140, 0.31366, 1e-4, "w4^2"),
    "A original: pad reached": (15.75, 15.71, 1e-2, "picture"),
    "A original: elements 2 and 3 meet": (19.23, 19.25, 2e-2, "both designs"),
    "A optimised: largest acceleration of 2": (18.15, 18.32, 2e-2, "exclude each other"),
    "A optimised: elements 2 and 3 meet": (19.23, 19.15, 1e-2, "both designs"),
    "B end of the motion of element 1": (32.6, 34.84, 1e-12, "fitted"),
    "B original: pad reached": (15.75, 15.78, 1.5e-2, "picture"),
    "B original: elements 2 and 3 meet": (19.23, 18.21, 1e-2, "both designs"),
    "B optimised: pad reached": (17.96, 17.76, 1e-2, "picture"),
    "B optimised: largest acceleration of 2": (18.15, 18.14, 1e-2, "exclude each other"),
    "original: element 2 over 1 at its pin": (71.8, 71.9, 1e-12, "Tab. 2"),
    "optimised: element 2 over 1 at its pin": (66.8, 66.9, 1e-12, "Tab. 2"),
}

NOT_PRINTED: dict[str, tuple[float, float]] = {
    "needle below the driven shaft at 22 deg": (557.854, 1e-3),
    "needle below the driven shaft at 194 deg": (557.819, 1e-3),
    "needle below the backing, lowest": (16.46, 1e-2),
    "torque on the driven shaft, largest": (132.4, 0.1),
    "torque on the driven shaft, at the stab": (121.9, 0.1),
    "balancing torque, largest": (17.2786, 1e-4),
    "balancing torque, largest, at": (24.82, 1e-2),
    "balancing torque just before the stab": (0.56, 1e-2),
    "balancing torque just after the stab": (17.25, 1e-2),
    "its friction part, largest": (16.76, 1e-2),
    "force on bearing C, largest": (2197, 1.0),
    "force on bearing O, largest": (1167, 1.0),
    "largest speed of the beater": (1.289, 1e-3),
    "its acceleration at the front dead centre": (25.05, 1e-2),
    "its largest acceleration the other way": (14.68, 1e-2),
    "load on joint C, largest": (101.49, 1e-2),
    "load on joint B, largest": (94.40, 1e-2),
    "speed of gear 2 over gear 1, smallest": (0.3099, 1e-4),
    "speed of gear 2 over gear 1, largest": (3.2264, 1e-4),
    "the same as a chord": (84.28, 1e-2),
    "its peak, gears 4 deg before their top ratio": (641.78, 1e-2),
    "angle from AD to the crank, sley in front": (61.2496, 1e-4),
    "sley before its rear point at 92 deg": (6.83, 1e-2),
    "sley before its rear point at 285 deg": (5.34, 1e-2),
    "original: gap between F and G at the start": (6.9, 1e-12),
    "optimised: gap between F and G at the start": (1.9, 1e-12),
}

# printed in words or as a range: the words, and a condition on the computed value
IN_WORDS: dict[str, tuple[str | None, tuple[float, float] | str]] = {
    "stroke of the needle": ("about 33", (32.7883, 32.7885)),
    "driven shaft over main shaft, largest torques": ("far greater", (7.6, 7.7)),
    "torque on the driven shaft, no friction": (None, "1.91 .. 5.13"),
    "balancing torque": (None, "-0.601 .. 17.279"),
    "its inertial part": (None, "-0.234 .. 0.211"),
    "its gravity part": (None, "-0.559 .. 0.553"),
    "inertia that the main shaft feels": (None, "5.0444 .. 6.5168"),
    "Eq. 9: t2": ("65.7 .. 78.3", "101.7 .. 114.3"),
    "Eq. 14: t5": ("101.5 .. 102.0", "258.0 .. 258.5"),
    "Eq. 15: beta1 lies between": ("l4 and l5", "l3 and l4"),
    "Eq. 12, 13, 20, 22, 23 hold at": ("any speed", "constant speed"),
    "Eq. 35: driven-shaft torque, no friction": ("2.35 .. 4.57", "1.91 .. 5.13"),
    "Eq. 30: matrix for nine unknowns": ("9 x 10", "9 x 9"),
    "Eq. 41: matrix for eight unknowns": ("8 x 9", "8 x 8"),
    "Eq. 39-43: y counts": ("up and down", "up"),
    "largest beat-up force": ("over 60", (63.5, 63.7)),
    "speed of the beater is largest": ("about beat-up", "68.8 deg before"),
    "load on joint C is largest": ("at beat-up", "9.2 deg before"),
    "load on joint B is largest": ("at beat-up", "9.5 deg before"),
    "Eq. 18, 19: sley in terms of t3": ("cos(t3 - pi/2)", "cos(t3 + pi/2)"),
    "acceleration at beat-up, k = 0.90 over k = 0.85": ("below 1, above 1", (0.6, 0.7)),
    "dwell at the rear": ("close to 200", (199.5, 200.5)),
    "dwell, k = 0.90 over k = 0.85": ("below 1, above 1", (0.87, 0.89)),
    "A original: element 2 leaves its pin by": ("leaves", (2.18, 2.20)),
    "A optimised: element 2 leaves its pin by": ("does not leave", (0.02, 0.04)),
    "B original: element 2 leaves its pin by": ("leaves", (3.35, 3.37)),
    "B optimised: element 2 leaves its pin by": ("does not leave", (0.76, 0.78)),
    "Eq. 1: pad's compression counts in": ("m", "mm"),
    "Eq. 13: pad's force acts": ("always", "in contact"),
    "Eq. 16: cone, position of 3 over that of": ("element 2", "element 1"),
    "pad begins at": ("94.9, 98.9", "94.9"),
}


@pytest.fixture(scope="module")
def every() -> Rows:
    """Make the rows of all papers, each with its name."""
    rows = (*tufting_rows(), *handloom_rows(), *elliptic_gear_rows(), *needle_transfer_rows())
    return [(f"{READINGS.get(row.section[:14], '')} {row.quantity}".strip(), row) for row in rows]


@pytest.fixture
def row(quantity: str, every: Rows) -> PublishedRow:
    return dict(every)[quantity]


@pytest.mark.parametrize("quantity", AGREE)
def test_agrees_with_print(quantity: str, row: PublishedRow) -> None:
    printed, computed, digit = AGREE[quantity]
    assert float(row.printed) == printed and row.agrees
    assert row.computed == pytest.approx(computed, abs=0.55 * digit)


@pytest.mark.parametrize("quantity", DIFFER)
def test_differs_from_print_for_a_reason(quantity: str, row: PublishedRow) -> None:
    printed, computed, digit, word = DIFFER[quantity]
    assert float(row.printed) == printed and row.agrees is False
    assert row.computed == pytest.approx(computed, abs=0.55 * digit)
    assert word in row.reason


@pytest.mark.parametrize("quantity", NOT_PRINTED)
def test_not_in_print(quantity: str, row: PublishedRow) -> None:
    computed, digit = NOT_PRINTED[quantity]
    assert row.printed is None and row.deviation is None
    assert row.computed == pytest.approx(computed, abs=0.55 * digit)


@pytest.mark.parametrize("quantity", IN_WORDS)
def test_words_and_ranges(quantity: str, row: PublishedRow) -> None:
    printed, holds = IN_WORDS[quantity]
    assert row.printed == printed and row.agrees is None
    if isinstance(holds, str):
        assert row.computed == holds
        assert row.reason or printed is None
    else:
        assert holds[0] < row.computed < holds[1]


def test_every_row_is_compared_once(every: Rows) -> None:
    held = [*AGREE, *DIFFER, *NOT_PRINTED, *IN_WORDS]
    assert sorted(held) == sorted(name for name, _ in every)


def test_last_digits() -> None:
    def row(printed: object, computed: object) -> PublishedRow:
        return PublishedRow("a paper", "a quantity", "m", printed, computed)  # type: ignore[arg-type]

    assert row(7.38, 7.387).last_places == pytest.approx(0.7)
    assert row("0.90", 0.906).last_places == pytest.approx(0.6)
    assert row(4.073e-5, 4.8e-5).last_places == pytest.approx(727)
    assert row(300.0, 301.0).agrees is False and row(300.0, 300.9).agrees
    pair = row("0.25 3.0", (0.254, 2.89))
    assert pair.last_places == pytest.approx(1.1) and pair.deviation is None
    for words in (row("over 60", 63.0), row(None, 1.0), row("1 .. 2", "1.0 .. 2.1"), row("1 2", (1.0, 2.0, 3.0))):
        assert words.last_places is None and words.agrees is None and words.deviation is None
    assert row("14.20", 14.202).deviation == pytest.approx(0.002)
