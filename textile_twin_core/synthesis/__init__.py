"""Designs of linkages: lengths from what the machine must do."""

from textile_twin_core.synthesis.crank_rocker import (
    CrankRockerDesign,
    CrankRockerSynthesis,
    LinkLengths,
    crank_rocker,
)
from textile_twin_core.synthesis.crank_rocker_family import CrankRockerFamily, LinkRatios

__all__ = [
    "CrankRockerDesign",
    "CrankRockerFamily",
    "CrankRockerSynthesis",
    "LinkLengths",
    "LinkRatios",
    "crank_rocker",
]
