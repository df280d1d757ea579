"""Design of linkages: dimensional synthesis, balancing, and evaluation of many designs at once."""

from textile_twin_core.synthesis.bars import CAST_IRON, BarSection
from textile_twin_core.synthesis.batch import Batch
from textile_twin_core.synthesis.crank_rocker import (
    CrankRockerDesign,
    CrankRockerSynthesis,
    LinkLengths,
    best_rotation,
    crank_rocker,
)
from textile_twin_core.synthesis.crank_rocker_family import CrankRockerFamily, LinkRatios
from textile_twin_core.synthesis.crank_rocker_machine import Tool, crank_rocker_machine
from textile_twin_core.synthesis.curve_fit import CurveDesign, fit_curve
from textile_twin_core.synthesis.family import Family, Parameter, family_of
from textile_twin_core.synthesis.four_bar import FourBarDesign
from textile_twin_core.synthesis.hand_positions import RockerThroughPoints, rocker_through
from textile_twin_core.synthesis.offset_slider import SliderCrankDesign, SliderCrankFamily, offset_slider
from textile_twin_core.synthesis.through_points import PointsDesign, through_points
from textile_twin_core.synthesis.turn import rotation_of_time_ratio

__all__ = [
    "CAST_IRON",
    "BarSection",
    "Batch",
    "CrankRockerDesign",
    "CrankRockerFamily",
    "CrankRockerSynthesis",
    "CurveDesign",
    "Family",
    "FourBarDesign",
    "LinkLengths",
    "LinkRatios",
    "Parameter",
    "PointsDesign",
    "RockerThroughPoints",
    "SliderCrankDesign",
    "SliderCrankFamily",
    "Tool",
    "best_rotation",
    "crank_rocker",
    "crank_rocker_machine",
    "family_of",
    "fit_curve",
    "offset_slider",
    "rocker_through",
    "rotation_of_time_ratio",
    "through_points",
]
