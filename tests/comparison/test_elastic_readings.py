"""The verdict on a machine whose file declares its elastic shaft."""

from __future__ import annotations

import numpy as np

from tests.generators.elastic_shaft import WideMachine
from tests.twin.test_elastic_session import declared, record
from textile_twin_core.comparison import assess
from textile_twin_core.comparison.elastic_readings import without_elasticity
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.recordings.bag import AngleSamples
from textile_twin_core.recordings.prediction import recompute


def test_a_declared_shaft_is_accused_of_nothing_and_a_gain_is_found() -> None:
    wide = WideMachine(0.06)
    made, machine = record(wide, 300.0), declared(wide, True)
    angle = np.mod(made.encoder_rad, 2.0 * np.pi)
    predicted = recompute(AngleSamples("main_shaft/angle", made.stamps_ns, angle, None), machine)
    known = (predicted.stamps_ns, predicted.torque_Nm, predicted.settled)
    for gain, causes in ((1.0, []), (1.3, ["torque_gain"])):
        readings = Readings(made.stamps_ns, angle, made.stamps_ns, gain * made.measured_Nm)
        judged = assess(without_elasticity(readings, machine, predicted.track, *known), machine, predicted.track)
        assert [cause.cause for cause in judged.verdict][:1] == causes
        assert judged.explained > 0.999
