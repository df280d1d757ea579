"""Table 1 of Topalbekiroglu and Celik 2010: all 33 rows, with its one misprint."""

from __future__ import annotations

import numpy as np
import pytest

from textile_twin_core.papers.crank_rocker import TABLE_1, table_1_designs, table_1_rows


@pytest.mark.parametrize(("printed", "design"), list(zip(TABLE_1, table_1_designs(), strict=True)))
def test_row_of_table_1(printed, design) -> None:  # type: ignore[no-untyped-def]
    rotation, beta, a, b, c, ratio, mu_min = printed
    assert np.degrees(design.beta_rad) == pytest.approx(beta, abs=1e-12)
    assert design.crank == pytest.approx(a, abs=2e-4)
    assert design.coupler == pytest.approx(b, abs=2e-4)
    if (rotation, beta) == (160, 55):
        assert design.rocker == pytest.approx(0.82145, abs=5e-6)
    else:
        assert design.rocker == pytest.approx(c, abs=2e-4)
    assert design.crank_over_coupler == pytest.approx(ratio, abs=0.005)
    assert np.degrees(design.mu_min_rad) == pytest.approx(mu_min, abs=0.0115)


def test_misprint_contradicts_its_own_row() -> None:
    """The printed c = 0.8225 at phi = 160, beta = 55 does not satisfy Eq. 3 with the printed a and b."""
    _, beta, a, b, c, *_ = next(row for row in TABLE_1 if row[:2] == (160, 55))
    cosine_law = np.sqrt((a + b) ** 2 + 1 - 2 * (a + b) * np.cos(np.radians(beta)))
    assert cosine_law == pytest.approx(0.8215, abs=1e-4)
    assert abs(cosine_law - c) > 9e-4


def test_rows_as_they_are_shown() -> None:
    table, text = table_1_rows()[:33], table_1_rows()[33:]
    assert len(TABLE_1) == len({row.quantity for row in table}) == 33
    assert [row.quantity for row in table if row.reason] == ["phi 160, beta 55", "phi 180, beta 35", "phi 210, beta 75"]
    assert [row.quantity for row in table if not row.agrees] == [row.quantity for row in table if row.reason]
    assert table[18].printed == "0.1991 0.6691 0.7694 0.30 67.24"
    assert [row.quantity for row in text if not row.agrees] == ["mechanisms in Table 1"]


def test_reasons_of_small_differences() -> None:
    """phi 180, beta 35: c of Eq. 15 from the printed a and b; phi 210: mu_min of Eq. 14 from the printed a."""
    _, _, a, b, c, *_ = next(row for row in TABLE_1 if row[:2] == (180, 35))
    assert np.sqrt(1 + a**2 - b**2) == pytest.approx(0.5938, abs=6e-5) != pytest.approx(c, abs=1e-4)
    a, mu_min = TABLE_1[-1][2], TABLE_1[-1][-1]
    assert np.degrees(np.arccos(2 * np.sqrt(a) / (1 + a))) == pytest.approx(mu_min, abs=5e-3)
