"""Files in and out: recordings, tables of motion, machine files."""

from textile_twin_core.files.atomic import OutputError, check_folder, staged
from textile_twin_core.files.bag import AngleSamples, Bag, PointSamples, TorqueSamples, open_bag
from textile_twin_core.files.bag_write import BagWriter
from textile_twin_core.files.recording import TopicInfo
from textile_twin_core.files.rosbag2_metadata import LATCHED, OfferedQos

__all__ = [
    "LATCHED",
    "AngleSamples",
    "Bag",
    "BagWriter",
    "OfferedQos",
    "OutputError",
    "PointSamples",
    "TopicInfo",
    "TorqueSamples",
    "check_folder",
    "open_bag",
    "staged",
]
