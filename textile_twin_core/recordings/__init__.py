"""Recordings in and out, and what is done with whole ones. Each part is imported when it is first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from textile_twin_core.recordings.bag import AngleSamples, Bag, PointSamples, TorqueSamples, open_bag
    from textile_twin_core.recordings.bag_write import BagWriter
    from textile_twin_core.recordings.rosbag2_metadata import LATCHED, OfferedQos, TopicInfo

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

_PLACES = {
    "bag": ("AngleSamples", "Bag", "PointSamples", "TorqueSamples", "open_bag"),
    "bag_write": ("BagWriter",),
    "rosbag2_metadata": ("LATCHED", "OfferedQos", "TopicInfo"),
}
_MODULES = {name: module for module, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'textile_twin_core.recordings' has no attribute '{name}'")
    return getattr(import_module(f"textile_twin_core.recordings.{_MODULES[name]}"), name)
