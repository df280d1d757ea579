#!/usr/bin/env bash
# Builds the nodes in the colcon workspace ros2_ws on a ROS installation. Ubuntu 24.04 and Debian 12 forbid installing into
# the system's Python (PEP 668), so further packages go into an environment that includes the packages of ROS.
set -euo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
venv="$root/ros2_ws/.venv"

fail() { echo "colcon.sh: $*" >&2; exit 2; }

case "${1:-}" in
    -h | --help)
        echo "usage: launch_scripts/colcon.sh [COLCON BUILD OPTIONS]    after: . /opt/ros/lyrical/setup.bash"
        exit
        ;;
esac
[ -n "${AMENT_PREFIX_PATH:-}" ] || fail "no ROS installation is sourced; first: . /opt/ros/lyrical/setup.bash (or jazzy)"
python="${PYTHON:-/usr/bin/python3}" # that for which ROS is built
"$python" -c 'import rclpy' 2> /dev/null || fail "$python does not find rclpy; name ROS's Python: PYTHON=/path/to/python3 $0"

if ! [ -x "$venv/bin/python" ]; then
    "$python" -m venv --system-site-packages "$venv" || fail "no environment; on Ubuntu and Debian: apt-get install python3-venv"
fi
touch "$venv/COLCON_IGNORE"
packages=("$root[files,view,plc]")
"$venv/bin/python" -c 'import colcon_core' 2> /dev/null || packages+=(colcon-common-extensions 'setuptools<80')
echo "Installing what ROS does not bring into $venv ..." >&2
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check "${packages[@]}"

# colcon writes the Python that runs it into the first line of each node.
cd "$root/ros2_ws"
"$venv/bin/python" -c 'import sys; from colcon_core.command import main; sys.exit(main())' build "$@"
cat >&2 <<'NEXT'
Next, in each shell:
  . ros2_ws/install/setup.bash
  ros2 launch textile_twin_ros twin.launch.py machine:=tufting shaft:=simulated
NEXT
