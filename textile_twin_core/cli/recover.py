"""textile-twin recover: complete recording from a truncated or damaged one."""

from __future__ import annotations

import argparse
from pathlib import Path

from textile_twin_core.cli.arguments import Parser
from textile_twin_core.cli.mistakes import tell
from textile_twin_core.cli.outputs import keep_input
from textile_twin_core.cli.progress import progress
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.recording_paths import check_place


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "recover",
        "Copies the intact part of a recording that was cut off by a kill or a power loss, or is damaged, into a"
        " complete one, with index and metadata.yaml, and reports what is lost.",
        "textile-twin recover recorded --out recovered",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="a rosbag2 folder, complete or not, or an .mcap file")
    parser.add_argument("--out", type=Path, required=True, metavar="BAG2", help="folder to make, or an .mcap file")
    parser.add_argument("--force", action="store_true", help="overwrite the output if it exists")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Copy the readable messages."""
    keep_input(arguments.out, arguments.bag)
    check_place(arguments.out, arguments.force)
    bag = open_bag(arguments.bag, salvage=True)
    tell(*bag.notices)
    if bag.message_count == 0:
        raise RecordingError(f"{arguments.bag}: no message can be read; nothing to recover")
    with (
        BagWriter(arguments.out, bag.metadata, overwrite=arguments.force) as out,
        progress(bag.message_count, "recovering") as done,
    ):
        for topic in bag.topics:
            out.copy_topic(bag, topic, done)
    seconds = (bag.end_ns - bag.start_ns) * 1e-9
    print(f"{arguments.out}: {bag.message_count} messages of {len(bag.topics)} topics, {seconds:.3f} s")
