"""Table 1 of Topalbekiroglu and Celik 2010: all 33 rows, with its one misprint."""

from __future__ import annotations

import numpy as np
import pytest

from textile_twin_core.synthesis.published import TABLE_1, table_1_designs, table_1_rows


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
    rows = table_1_rows()
    assert len(TABLE_1) == 33 and len(rows) == 35
    assert len({row.quantity for row in rows}) == 35
    assert [row.reason for row in rows if "misprint" in row.reason] == [
        "c is a misprint: with the row's own a, b and mu_min it is 0.8215"
    ]
    assert rows[18].printed == rows[18].computed == "0.1991 0.6691 0.7694 0.30 67.24"
    assert rows[-1].computed == pytest.approx(48.0, abs=1e-12)
