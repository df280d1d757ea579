"""Choice of the parameters that a record can separate, made before the fit from their effects on the torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray

MOST_INFLATION = 2e4
"""Variance inflation factor (Belsley, Kuh and Welsch 1980) above which effects count as the same."""
_NO_EFFECT = 1e-9


@dataclass(frozen=True)
class NotIdentifiable:
    """A parameter that this record does not determine, and the reason."""

    name: str
    text: str


def identifiable(
    jacobian: FloatArray, names: Sequence[str], drop_order: Sequence[str]
) -> tuple[list[str], list[NotIdentifiable]]:
    """Return the parameters that are distinguishable together, and those dropped to make them so.

    Args:
        jacobian: (n, k) effects of the parameters on the measured torque. names: of its columns.
        drop_order: the order in which parameters with indistinguishable effects are dropped.
    """
    kept, lost = list(names), list[NotIdentifiable]()
    sizes = dict(zip(names, np.sqrt(np.mean(jacobian**2, axis=0)).tolist(), strict=True))
    for name in names:
        if not sizes[name] > _NO_EFFECT * max(sizes.values()) * 1e-3:
            kept.remove(name)
            lost.append(NotIdentifiable(name, f"{name} has no effect in this recording"))
    order = [*drop_order, *(name for name in reversed(names) if name not in drop_order)]
    while kept:
        columns = np.stack([jacobian[:, list(names).index(name)] / sizes[name] for name in kept], axis=1)
        normal = columns.T @ columns / columns.shape[0]
        values, vectors = np.linalg.eigh(normal)
        inflation = np.einsum("kj,j->k", vectors**2, 1.0 / np.maximum(values, 1e-300)) * np.diag(normal)
        if float(inflation.max()) < MOST_INFLATION:
            break
        tangled = [kept[k] for k in np.flatnonzero(np.abs(vectors[:, 0]) > 0.1)]
        gone = next(name for name in order if name in tangled)
        partners = [name for name in tangled if name != gone]
        kept.remove(gone)
        text = f"{gone} cannot be distinguished from {' and '.join(partners)} in this recording; it stays as configured"
        lost.append(NotIdentifiable(gone, text))
    return kept, lost
