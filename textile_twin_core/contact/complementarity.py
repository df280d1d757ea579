"""One-sided forces: each pushes or is zero, each gap opens or stays, never both."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray


class JammedError(Exception):
    """No forces keep every gap from closing; whoever knows the stops says so in their names."""


def one_sided_forces(normals: FloatArray, masses: FloatArray, opening: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Forces f >= 0 with w = N^T M^-1 N f + opening >= 0 and f w = 0, and w itself.

    `normals` N is (bodies, stops), `masses` (bodies,), `opening` (stops,) what the gaps would do with no force:
    their acceleration (f in N) or (1 + restitution) times their closing speed (f in N s). The forces are those of
    Gauss' principle of least constraint, a non-negative least-squares problem.
    Raises JammedError when no force can keep a gap from closing: a body between driven element and frame.
    """
    count = opening.size
    if count == 0 or bool((opening >= 0.0).all()):
        return np.zeros(count), opening
    weighted = normals / np.sqrt(masses)[:, None]
    if count == 1:
        response = float(weighted[:, 0] @ weighted[:, 0])
        force = -float(opening[0]) / response
        return np.array([force]), np.zeros(1)
    target = np.linalg.lstsq(weighted.T, -opening, rcond=None)[0]
    from scipy.optimize import nnls  # slow to import, and few states have stops that depend on each other

    forces = nnls(weighted, target)[0]
    pushing = forces > 0.0
    # the active set is right to rounding; its forces are solved for again so that their gaps stay shut exactly
    if pushing.any():
        part = weighted[:, pushing]
        forces[pushing] = np.linalg.lstsq(part.T @ part, -opening[pushing], rcond=None)[0]
    result = weighted.T @ (weighted @ forces) + opening
    if result.min() < -1e-9 * float(np.abs(opening).max()):
        raise JammedError
    result[pushing] = 0.0
    return forces, result
