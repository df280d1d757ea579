"""Start, spin and end a node: the executor by name, one clear line for the user's mistakes, exit codes."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, cast

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from textile_twin_core.errors import TwinError

EXECUTORS = ("events", "single")
# How long one spin may last before it looks whether the node has finished.
SPIN_S = 0.2


class SuiteNode(Protocol):
    """An rclpy node of the suite: what it offers for its start and its end."""

    executor_name: str
    finished: Future  # done when the node has nothing left to do; its result is the exit code

    def close(self) -> None:
        """Finish files and threads; called once, also after a signal, before the node is destroyed."""

    def destroy_node(self) -> None:
        """Destroy the rclpy node."""


def call_every(node: Node, period_s: float, callback: Callable[[], None]) -> None:
    """Call a function every so often in real time, also where the node's time is that of a recording."""
    node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def create_executor(name: str, context: Context | None = None) -> Executor:
    """An executor: `events` costs a third of `single` per message and is the default wherever it serves."""
    if name == "events":
        from rclpy.experimental.events_executor import EventsExecutor

        return EventsExecutor(context=context)
    return SingleThreadedExecutor(context=context)


def run(command: str, create: Callable[[], SuiteNode], arguments: list[str] | None = None) -> int:
    """Run one node until it finishes or is told to end, and return the process's exit code.

    0 after SIGINT, SIGTERM or the node's own end; 2 for the user's mistake, told in one line on stderr.
    """
    if not {"HOME", "ROS_HOME", "ROS_LOG_DIR"} & os.environ.keys():
        # A service of the system has no home, and rclpy does not start without a place for its log.
        os.environ["ROS_LOG_DIR"] = str(Path(tempfile.gettempdir()) / "ros_log")
    try:
        rclpy.init(args=arguments)
    except Exception as error:  # rclpy's argument errors have no common base
        return _tell(command, error)
    nodes: list[SuiteNode] = []
    code = 0
    try:
        nodes.append(create())
        code = _spin(nodes[0])
    except TwinError as error:
        code = _tell(command, error)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("textile_twin"):
            raise
        package = error.name.partition(".")[0]
        code = _tell(command, f"this node needs the package {package}: pip install 'textile-twin-core[files,view]'")
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except Exception:
        # A signal may take the context away in the middle of any call: that is an end like any other.
        if rclpy.ok():
            raise
    finally:
        code = max(code, _end(command, nodes))
    return code


def finish_with(finished: Future, work: Callable[[], int]) -> None:
    """Do a node's work, in a thread of its own, and finish the node with its exit code or its error."""
    try:
        finished.set_result(work())
    except Exception as error:  # handed on to the main thread, which tells it
        finished.set_exception(error)


def _spin(node: SuiteNode) -> int:
    executor = create_executor(node.executor_name)
    executor.add_node(cast(Node, node))
    # EventsExecutor.spin() and spin_once() ignore signals; this form does not.
    while rclpy.ok() and not node.finished.done():
        executor.spin_until_future_complete(node.finished, timeout_sec=SPIN_S)
    return int(node.finished.result()) if node.finished.done() else 0


def _end(command: str, nodes: list[SuiteNode]) -> int:
    """Close and destroy the nodes; the exit code that follows from it."""
    # An impatient second Ctrl-C must not cut off the writing of a file.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    try:
        for node in nodes:
            node.close()
            node.destroy_node()
    except TwinError as error:
        return _tell(command, error)
    finally:
        rclpy.try_shutdown()
    return 0


def _tell(command: str, error: Exception | str) -> int:
    """One line for the person who made the mistake; its exit code."""
    print(f"{command}: {' '.join(str(error).split())}", file=sys.stderr)
    return 2
