# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""Start, spin and end a node: the executor by name, one clear line for the user's mistakes, exit codes."""

from __future__ import annotations

import gc
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Protocol, cast
from weakref import WeakKeyDictionary

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from textile_twin_core.errors import SceneError, TwinError, how_to_install
from textile_twin_ros.commands import ENDING_SIGNALS
from textile_twin_ros.publishing import RCLError, UnknownROSArgsError
from textile_twin_ros.usage import explain, read_words

EXECUTORS = ("events", "single")
_REFUSALS = (ParameterException, InvalidQosOverridesError, RCLError)
# How soon it is noticed that the node has finished or has to end.
_LOOK_S = 0.2
# Each spin of the events executor leaves 32 bytes behind, and each callback of the other one adds to the future of the
# spin: spins are not short, and each has a future of its own. A node that has fallen behind looks between two of them.
_SPIN_S = 1.0
_OVERDUE_S = 0.5


class SuiteNode(Protocol):
    """An rclpy node of the suite, with its start and its end."""

    executor_name: str
    finished: Future  # done when the node has nothing left to do; its result is the exit code

    def close(self) -> None:
        """Finish files and threads; called once, also after a signal, before the node is destroyed."""

    def destroy_node(self) -> None:
        """Destroy the rclpy node."""


class _Regular:
    """Periodic task of a node."""

    def __init__(self, period_s: float, callback: Callable[[], None]) -> None:
        self._period_s, self._callback = period_s, callback
        self._done_s = time.monotonic()

    def do(self) -> None:
        """Do it now."""
        self._done_s = time.monotonic()
        self._callback()

    def do_if_overdue(self) -> None:
        """Do it where it is long overdue."""
        if time.monotonic() - self._done_s > self._period_s + _OVERDUE_S:
            self.do()


_REGULAR: WeakKeyDictionary[Node, list[_Regular]] = WeakKeyDictionary()


def call_every(node: Node, period_s: float, callback: Callable[[], None]) -> None:
    """Call a function every so often in real time, also where the node's time is that of a recording.

    The events executor comes to a timer when it has been through all that came before: inputs call `run_overdue_tasks`.
    """
    regular = _Regular(period_s, callback)
    _REGULAR.setdefault(node, []).append(regular)
    node.create_timer(period_s, regular.do, clock=Clock(clock_type=ClockType.STEADY_TIME))


def run_overdue_tasks(node: Node) -> None:
    """Run overdue periodic tasks where messages come faster than the node takes them."""
    for regular in _REGULAR.get(node, ()):
        regular.do_if_overdue()


def create_executor(name: str, context: Context | None = None) -> Executor:
    """An executor: `events` costs a third of `single` per message and is the default wherever it serves."""
    if name == "events":
        from rclpy.experimental.events_executor import EventsExecutor

        return EventsExecutor(context=context)
    return SingleThreadedExecutor(context=context)


class _Ending:
    """Flag of an ending signal; rclpy's own handlers end the context under running callbacks."""

    def __init__(self) -> None:
        self.requested = False
        for number in ENDING_SIGNALS:
            signal.signal(number, self._tell)

    def _tell(self, _number: int, _frame: FrameType | None) -> None:
        self.requested = True


@contextmanager
def ends_at_once() -> Iterator[None]:
    """A signal ends the process amid this block of the main thread, which takes long and has nothing to be closed."""
    before = {number: signal.signal(number, lambda *_: os._exit(0)) for number in ENDING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run(command: str, create: Callable[[], SuiteNode], declaration: type, arguments: list[str] | None = None) -> int:
    """Run one node until it finishes or has to end, and return the process's exit code.

    0 after SIGINT, SIGTERM or the node's own end; 2 for the user's mistake, one line on stderr.

    Args:
        command: the node's command, as messages name it.
        create: makes the node.
        declaration: the dataclass of its parameters.
        arguments: the command line with its first word; None is that of the process.
    """
    if not {"HOME", "ROS_HOME", "ROS_LOG_DIR"} & os.environ.keys():
        # A service of the system has no home, and rclpy does not start without a place for its log.
        os.environ["ROS_LOG_DIR"] = str(Path(tempfile.gettempdir()) / "ros_log")
    ending = _Ending()
    try:
        summary = " ".join((sys.modules[create.__module__].__doc__ or "").split())
        text = read_words(command, summary, declaration, arguments)
        if text is not None:
            sys.stdout.write(f"{text}\n")
            sys.stdout.flush()
            return 0
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except BrokenPipeError:  # who reads the help has enough, as `head` does
        _say_no_more()
        return 0
    except UnknownROSArgsError as error:
        return _tell(command, f"not known after --ros-args: {error}; a parameter is written as -p NAME:=VALUE")
    except Exception as error:  # rclpy's argument errors have no common base
        return _tell(command, explain(error))
    nodes: list[SuiteNode] = []
    code = 0
    try:
        nodes.append(_created(create))
        code = _spin(nodes[0], ending)
    except TwinError as error:
        code = _tell(command, error)
    except OSError as error:  # no permission, no room, a vanished disk: as the command line has it
        code = _tell(command, f"{f'{error.filename}: ' if error.filename else ''}{error.strerror or error}")
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("textile_twin"):
            raise
        package = error.name.partition(".")[0]
        code = _tell(command, f"this node needs the package {package}; {how_to_install(package)}")
    finally:
        code = max(code, _end(command, nodes))
    return code


def _created(create: Callable[[], SuiteNode]) -> SuiteNode:
    """Create the node; parameters that rclpy refuses, or settings of the middleware, are the user's mistake.

    Raises:
        SceneError: a parameter of rclpy's own has a wrong value, or the middleware cannot give what the environment
            asks for, such as security.
    """
    try:
        return create()
    except Exception as error:
        if is_refusal(error):
            raise SceneError(str(error)) from error
        raise


def is_refusal(error: Exception) -> bool:
    """Return whether rclpy or the middleware refuses a parameter, a name or a quality of service."""
    return isinstance(error, _REFUSALS) or (type(error) is RuntimeError and "QoS override" in str(error))


def finish_with(finished: Future, work: Callable[[], int]) -> None:
    """Do a node's work, in a thread of its own, and finish the node with its exit code or its error."""
    try:
        finished.set_result(work())
    except Exception as error:  # reported by the main thread
        finished.set_exception(error)


def _spin(node: SuiteNode, ending: _Ending) -> int:
    executor = create_executor(node.executor_name)
    executor.add_node(cast(Node, node))
    turn = Future()

    def look() -> None:
        if (ending.requested or node.finished.done()) and not turn.done():
            turn.set_result(None)

    call_every(cast(Node, node), _LOOK_S, look)  # with it Python hears of a signal, too
    # What is loaded by now stays: looking through all of it for what is no longer used would keep samples waiting for a
    # tenth of a second now and then.
    gc.collect()
    gc.freeze()
    while not ending.requested and not node.finished.done():
        turn = Future()
        executor.spin_until_future_complete(turn, timeout_sec=_SPIN_S)
    return int(node.finished.result()) if node.finished.done() else 0


def _end(command: str, nodes: list[SuiteNode]) -> int:
    """Close and destroy the nodes; the exit code that follows from it."""
    # An impatient second Ctrl-C must not cut off the writing of a file.
    for number in ENDING_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    try:
        for node in nodes:
            node.close()
            node.destroy_node()
    except TwinError as error:
        return _tell(command, error)
    except BrokenPipeError:  # who reads what it says has gone; its work is done
        _say_no_more()
    finally:
        rclpy.try_shutdown()
    return 0


def _say_no_more() -> None:
    """Let Python write to nowhere as it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell(command: str, error: Exception | str) -> int:
    """One line for the person who made the mistake; its exit code."""
    print(f"{command}: {' '.join(str(error).split())}", file=sys.stderr)
    return 2
