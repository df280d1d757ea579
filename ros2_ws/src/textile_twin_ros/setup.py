"""The ROS 2 nodes of textile-twin: built by colcon into a workspace, or by pip into an environment."""

from pathlib import Path

from setuptools import setup

PACKAGE = "textile_twin_ros"
NODES = (
    "twin_node",
    "replay_node",
    "record_node",
    "shaft_node",
    "view_node",
    "plc_node",
    "opcua_node",
    "monitor_node",
    "fault_node",
    "opcua_server_node",
)


def files(pattern: str) -> list[str]:
    """The package's files of this pattern, relative to this folder as setuptools wants them."""
    here = Path(__file__).parent
    return sorted(str(path.relative_to(here)) for path in here.glob(pattern))


setup(
    name=PACKAGE,
    version="0.1.0",
    description="ROS 2 nodes of textile-twin: the digital twin of a textile machine, from the angle of its main shaft",
    license="Apache-2.0",
    packages=[PACKAGE],
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", files("launch/*.launch.py")),
        (f"share/{PACKAGE}/config", files("config/*.yaml")),
        (f"share/{PACKAGE}/layouts", files("layouts/*")),
    ],
    python_requires=">=3.10",
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [f"{node} = {PACKAGE}.commands:{node}" for node in NODES],
        "textile_twin.status": [f"show = {PACKAGE}.status:show"],
    },
)
