"""Table 1 of Topalbekiroglu and Celik 2010 as printed, and the synthesis of the same designs."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.papers.beatup import HANDLOOM
from textile_twin_core.papers.rows import PublishedRow
from textile_twin_core.synthesis.crank_rocker import CrankRockerDesign, crank_rocker

SWING_DEG = 30.0

TABLE_1: tuple[tuple[float, float, float, float, float, float, float], ...] = (
    # rotation phi and beta [deg], crank a, coupler b, rocker c over the ground link, r/l, mu_min [deg]
    (120, 75, 0.2588, 0.2588, 1.0, 1.00, 0.0),
    (120, 72, 0.2449, 0.2720, 0.9735, 0.90, 4.33),
    (120, 70, 0.2353, 0.2804, 0.9556, 0.84, 4.66),
    (120, 67, 0.2203, 0.2923, 0.9285, 0.75, 4.13),
    (120, 64, 0.2047, 0.3034, 0.9015, 0.67, 2.78),
    (120, 60, 0.1830, 0.3170, 0.8660, 0.58, 0.0),
    (160, 70, 0.2473, 0.3062, 0.9632, 0.81, 25.08),
    (160, 65, 0.2340, 0.3513, 0.9208, 0.67, 31.53),
    (160, 57, 0.2089, 0.4177, 0.8427, 0.50, 34.97),
    (160, 55, 0.2019, 0.4331, 0.8225, 0.47, 35.06),
    (160, 53, 0.1948, 0.4479, 0.7997, 0.43, 34.92),
    (160, 43, 0.1555, 0.5136, 0.6848, 0.30, 31.08),
    (160, 35, 0.1207, 0.5550, 0.5912, 0.22, 24.27),
    (160, 30, 0.0977, 0.5755, 0.5359, 0.17, 18.04),
    (180, 70, 0.2518, 0.3420, 0.9728, 0.74, 40.82),
    (180, 67, 0.2467, 0.3907, 0.9530, 0.63, 48.52),
    (180, 55, 0.2195, 0.5736, 0.8481, 0.38, 63.18),
    (180, 50, 0.2053, 0.6428, 0.7931, 0.32, 66.26),
    (180, 48, 0.1991, 0.6691, 0.7694, 0.30, 67.24),
    (180, 47, 0.1960, 0.6820, 0.7572, 0.29, 67.70),
    (180, 40, 0.1722, 0.7660, 0.6655, 0.22, 70.25),
    (180, 35, 0.1537, 0.8192, 0.5940, 0.19, 71.58),
    (180, 10, 0.0465, 0.9848, 0.1798, 0.05, 74.76),
    (200, 70, 0.2559, 0.5157, 1.0332, 0.50, 42.97),
    (200, 67, 0.2532, 0.6680, 1.0624, 0.38, 44.23),
    (200, 66, 0.2521, 0.7184, 1.0735, 0.35, 44.02),
    (200, 60, 0.2441, 1.0157, 1.1521, 0.24, 40.20),
    (200, 50, 0.2250, 1.4848, 1.3135, 0.15, 31.40),
    (200, 40, 0.1990, 1.9088, 1.4878, 0.10, 23.33),
    (200, 30, 0.1670, 2.2749, 1.6533, 0.07, 16.44),
    (200, 25, 0.1490, 2.4326, 1.7278, 0.06, 13.36),
    (200, 10, 0.0889, 2.7905, 1.9025, 0.03, 5.07),
    (210, 75, 0.2589, 0.5708, 1.122, 0.45, 36.06),
)

_WHY = {
    (160.0, 55.0): "c is a misprint: the row's own a, b and mu_min belong to 0.8215",
    (180.0, 35.0): "c is two units too large: the row's own a and b give 0.5938 (Eq. 15)",
    (210.0, 75.0): "mu_min follows from a as printed; a is cos 75 deg = 0.25882",
}
_SECTION = "Table 1, by phi and beta [deg]: a, b, c, r/l, mu_min [deg]"


def table_1_designs() -> tuple[CrankRockerDesign, ...]:
    """Synthesise the design of each row of Table 1, in its order."""
    found: dict[float, dict[int, CrankRockerDesign]] = {}
    for rotation in dict.fromkeys(row[0] for row in TABLE_1):
        designs = crank_rocker(math.radians(SWING_DEG), math.radians(rotation)).designs
        found[rotation] = {round(float(np.degrees(design.beta_rad))): design for design in designs}
    return tuple(found[row[0]][round(row[1])] for row in TABLE_1)


def table_1_rows() -> tuple[PublishedRow, ...]:
    """Compare each row of Table 1, its five numbers together, and the statements of the text on the table."""
    rows = [
        PublishedRow(
            HANDLOOM,
            f"phi {rotation:g}, beta {beta:g}",
            "",
            _text(printed),
            _numbers(design),
            _WHY.get((rotation, beta), ""),
            _SECTION,
        )
        for (rotation, beta, *printed), design in zip(TABLE_1, table_1_designs(), strict=True)
    ]
    count = PublishedRow(
        HANDLOOM, "mechanisms in Table 1", "", 32.0, float(len(TABLE_1)), "the table has 33 rows", _DESIGN
    )
    return (*rows, count, *_chosen_design_rows())


_DESIGN = "Count of Table 1, and the chosen design"


def _chosen_design_rows() -> list[PublishedRow]:
    best = crank_rocker(math.radians(SWING_DEG), math.pi).best
    assert best is not None, "at phi = 180 deg the transmission angle is within 40 deg of 90"
    lengths = best.scaled(_GROUND_M)
    rows = (
        ("beta, phi 180", "deg", 48.0, round(float(np.degrees(best.beta_rad)), 9)),
        ("crank DC, for a ground link AD of 0.3 m", "m", 0.0597, lengths.crank_m),
        ("coupler CB", "m", 0.2007, lengths.coupler_m),
    )
    return [PublishedRow(HANDLOOM, *row, section=_DESIGN) for row in rows]


_GROUND_M = 0.3


def _numbers(design: CrankRockerDesign) -> tuple[float, ...]:
    mu_min = float(np.degrees(design.mu_min_rad))
    return design.crank, design.coupler, design.rocker, design.crank_over_coupler, mu_min


def _text(numbers: list[float]) -> str:
    a, b, c, ratio, mu_min = numbers
    return f"{a:.4f} {b:.4f} {c:.4f} {ratio:.2f} {mu_min:.2f}"
