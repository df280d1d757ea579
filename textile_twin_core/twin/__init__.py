"""Twins: machines compiled for the outputs of a scene, and sessions that feed them with angle samples."""

from textile_twin_core.twin.compiled import Twin, compile_machine
from textile_twin_core.twin.history import HistoryTwin
from textile_twin_core.twin.session import Samples, Session

__all__ = ["HistoryTwin", "Samples", "Session", "Twin", "compile_machine"]
