"""Twins: machines compiled for the outputs of a scene, and sessions that evaluate them at angle samples."""

from textile_twin_core.twin.compilation import compile_machine, compile_rigid, idle_twin
from textile_twin_core.twin.compiled import Twin
from textile_twin_core.twin.elastic import ElasticTwin
from textile_twin_core.twin.history import HistoryTwin
from textile_twin_core.twin.session import Samples, Session

__all__ = ["ElasticTwin", "HistoryTwin", "Samples", "Session", "Twin", "compile_machine", "compile_rigid", "idle_twin"]
