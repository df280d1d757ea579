"""Parameters as `ros2 param` sees them: described, checked, read-only or live."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from tests.ros.suite import node_environment
from textile_twin_core.errors import SceneError
from textile_twin_ros.parameters import declare, parameter


@dataclasses.dataclass
class Example:
    """One parameter of each kind."""

    kind: str = parameter("a", "a choice", choices=("a", "b"))
    rate: float = parameter(1.0, "a rate in Hz", between=(0.0, 10.0), live=True)
    count: int = parameter(3, "a count", between=(0, 5))
    active: bool = parameter(True, "whether")
    topics: tuple[str, ...] = parameter((), "some topics")


@pytest.fixture
def create_node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    for name, value in node_environment(tmp_path, domain=101).items():
        monkeypatch.setenv(name, value)
    context = rclpy.Context()
    rclpy.init(context=context)
    yield lambda **given: Node(
        "example", context=context, parameter_overrides=[Parameter(name, value=value) for name, value in given.items()]
    )
    rclpy.shutdown(context=context)


def test_values_hold_their_types(create_node: Any) -> None:
    held = declare(create_node(rate=2, topics=["x", "y"]), Example)
    assert held == Example(rate=2.0, topics=("x", "y"))
    assert type(held.rate) is float
    assert declare(create_node(), Example) == Example()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"kind": "c"}, "parameter 'kind' is 'c': choose one of a, b"),
        ({"rate": 11.0}, "rate"),
        ({"rate": 11}, "parameter 'rate' is 11.0: it must lie between 0 and 10"),
        ({"count": 6}, "parameter 'count' is 6: it must lie between 0 and 5"),
        ({"count": "many"}, "parameter 'count' must be a whole number"),
        ({"active": 1}, "parameter 'active' must be true or false"),
        ({"topics": [1, 2]}, "parameter 'topics' must be a list of texts"),
    ],
)
def test_what_is_wrong_is_reported(create_node: Any, given: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        declare(create_node(**given), Example)


def test_live_parameters_change_and_others_do_not(create_node: Any) -> None:
    node, changed = create_node(), []
    held = declare(node, Example, changed.append)
    assert node.set_parameters([Parameter("rate", value=5)])[0].successful
    assert (held.rate, changed) == (5.0, ["rate"])
    refused = node.set_parameters([Parameter("rate", value=50.0), Parameter("kind", value="b")])
    assert [result.successful for result in refused] == [False, False]
    assert held == Example(rate=5.0)


def test_every_parameter_has_a_type_when_it_is_dumped(create_node: Any) -> None:
    """`ros2 param dump` asks for all parameters and gives nothing at all when one of them is unset."""
    node = create_node()
    declare(node, Example)
    names = [field.name for field in dataclasses.fields(Example)]
    dumped = {parameter.name: parameter.value for parameter in node.get_parameters(names)}
    assert Parameter.Type.NOT_SET not in {parameter.type_ for parameter in node.get_parameters(names)}
    # What was dumped may be given back.
    assert declare(create_node(**dumped), Example) == Example()


@pytest.mark.parametrize("name", ["twin", "replay", "record", "shaft", "view"])
def test_every_parameter_of_every_node_is_described(create_node: Any, name: str) -> None:
    module = importlib.import_module(f"textile_twin_ros.{name}_node")
    declaration = getattr(module, f"{name.capitalize()}Parameters")
    node = create_node()
    declare(node, declaration)
    for field in dataclasses.fields(declaration):
        descriptor = node.describe_parameter(field.name)
        assert len(descriptor.description) > 10
        assert descriptor.read_only != field.metadata["live"]
