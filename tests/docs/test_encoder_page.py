"""docs/how_to/publish_your_encoder.md: its driver gives a twin readings that it predicts from, one each."""

from __future__ import annotations

import itertools
import math
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

from tests.docs.pages import blocks
from tests.ros.suite import RELIABLE, Program, running_suite

PAGE = Path("docs/how_to/publish_your_encoder.md")


PUBLISH = "        self.publisher.publish(message)\n"


def driver_of_the_page(folder: Path) -> Path:
    (code,) = (block.text for block in blocks(PAGE) if block.language == "python")
    assert code.count("\n") < 50 and PUBLISH in code
    file = folder / "encoder_driver.py"
    file.write_text(code)
    return file


def test_the_driver_ends_well_when_a_signal_comes_before_it_publishes(tmp_path: Path) -> None:
    file = driver_of_the_page(tmp_path)
    file.write_text(file.read_text().replace(PUBLISH, "        time.sleep(0.05)\n" + PUBLISH))
    with running_suite(tmp_path) as suite:
        driver = Program([sys.executable, str(file)], tmp_path / "driver.log", suite.environment)
        suite.processes.append(driver)
        driver.wait_for_words("publishing")
        assert driver.end() == 0 and "Traceback" not in driver.words()


@pytest.mark.slow
def test_the_driver_of_the_page_runs_a_twin(tmp_path: Path) -> None:
    """Each prediction has the stamp of one reading, stamps rise, and the speed is that of the page's shaft."""
    file = driver_of_the_page(tmp_path)
    with running_suite(tmp_path) as suite:
        read: dict[int, float] = {}
        predicted: list[int] = []
        node = suite.node()

        def stamp(message: JointState | WrenchStamped) -> int:
            return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec

        node.create_subscription(
            JointState, "loom_3/main_shaft/angle", lambda m: read.update({stamp(m): m.position[0]}), RELIABLE
        )
        node.create_subscription(
            WrenchStamped, "loom_3/balancing_torque/predicted", lambda m: predicted.append(stamp(m)), RELIABLE
        )
        twin = suite.start("twin_node", "machine:=tufting", remaps=["__ns:=/loom_3"])
        twin.wait_for_words("predicting from")
        command = [sys.executable, str(file), "--ros-args", "-r", "__ns:=/loom_3"]
        driver = Program(command, tmp_path / "driver.log", suite.environment)
        suite.processes.append(driver)
        suite.spin_until(lambda: len(predicted) > 1000, "a thousand predictions")
        assert driver.end() == 0 and "Traceback" not in driver.words()
        suite.spin_for(1.0)  # a prediction may arrive before the reading that it belongs to
        stamps = sorted(read)
        heard = [each for each in predicted if each >= stamps[0]]  # the twin may hear the driver first
        assert len(heard) > 500 and set(heard) <= set(read) and len(set(heard)) == len(heard)
        turned = sum(math.remainder(read[b] - read[a], 2.0 * math.pi) for a, b in itertools.pairwise(stamps))
        speed = turned / ((stamps[-1] - stamps[0]) * 1e-9)
        assert speed == pytest.approx(160.0 * math.pi / 30.0, rel=1e-3)
