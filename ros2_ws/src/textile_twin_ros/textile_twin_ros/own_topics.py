"""Which topics are those of one machine: a namespace is a machine, and topics in another's are not ours."""

from __future__ import annotations

from collections.abc import Iterable

#: Topics that all machines share.
SHARED = ("/diagnostics", "/clock", "/tf", "/tf_static")
NODES = ("twin_node", "replay_node", "record_node", "shaft_node", "view_node", "plc_node", "opcua_node", "monitor_node")
# Only a machine has these: other topics in the same namespace are that machine's, too.
_OF_A_MACHINE = (
    "twin_node/transition_event",
    "main_shaft/angle",
    "balancing_torque/measured",
    "balancing_torque/predicted",
)
#: What sensors tell of a machine, and what its twin does.
INPUTS = ("main_shaft/angle", "main_shaft/index", "balancing_torque/measured")
OUTPUTS = (
    "balancing_torque/predicted",
    "balancing_torque/predicted_sigma",
    "balancing_torque/residual",
    "needle/position",
    "beater/position",
    "sley/position",
    "joint_states",
    "contact_events",
    "robot_description",
    "markers",
)
_NAMES = (*_OF_A_MACHINE, *INPUTS, *OUTPUTS)


class OwnTopics:
    """Tells the topics of the machine in a namespace from those of machines in other namespaces.

    Args:
        namespace: the machine's namespace, "/" for none.
    """

    def __init__(self, namespace: str) -> None:
        self._own = namespace.rstrip("/") + "/"
        self._others: set[str] = set()

    def learn(self, topics: Iterable[str]) -> None:
        """Take note of the machines that these topics show."""
        for topic in topics:
            place = _namespace(topic, _OF_A_MACHINE)
            if place is not None and place != self._own:
                self._others.add(place)

    def has(self, topic: str) -> bool:
        """Whether a topic is this machine's or shared by all."""
        if topic in SHARED:
            return True
        if not topic.startswith(self._own) or _namespace(topic, _NAMES) not in (None, self._own):
            return False
        return not any(topic.startswith(other) for other in self._others if len(other) > len(self._own))

    def speaks_of(self, status_name: str) -> bool:
        """Whether a diagnostic status, named as `machine_3/twin_node: what`, is not of another machine's node."""
        node = "/" + status_name.partition(":")[0].strip("/ ")
        place, _, name = node.rpartition("/")
        return name not in NODES or place + "/" == self._own


def _namespace(topic: str, names: Iterable[str]) -> str | None:
    """The namespace, with a slash at its end, before one of these names; None when the topic is none of them."""
    for name in names:
        if topic.endswith(f"/{name}"):
            return topic.removesuffix(name)
    return None
