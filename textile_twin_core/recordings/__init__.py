"""Recordings: reading, writing, and processing of whole ones. Each part is imported when first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textile_twin_core.lazy import listing_of, names_of

if TYPE_CHECKING:
    from textile_twin_core.recordings.bag import Bag, open_bag
    from textile_twin_core.recordings.bag_write import BagWriter
    from textile_twin_core.recordings.rosbag2_metadata import LATCHED, OfferedQos, TopicInfo
    from textile_twin_core.recordings.samples import AngleSamples, PointSamples, TorqueSamples

__all__ = [
    "LATCHED",
    "AngleSamples",
    "Bag",
    "BagWriter",
    "OfferedQos",
    "PointSamples",
    "TopicInfo",
    "TorqueSamples",
    "open_bag",
]

__dir__ = listing_of(__all__)
__getattr__ = names_of(
    __name__,
    {
        "AngleSamples": "samples",
        "Bag": "bag",
        "BagWriter": "bag_write",
        "LATCHED": "rosbag2_metadata",
        "OfferedQos": "rosbag2_metadata",
        "PointSamples": "samples",
        "TopicInfo": "rosbag2_metadata",
        "TorqueSamples": "samples",
        "open_bag": "bag",
    },
)
