#!/usr/bin/env bash
# Starts the suite beside a machine, without a ROS installation: the twin, a recording, and a view that can be looked at live.
set -euo pipefail

if [ "${1:-}" = --help ] || [ "${1:-}" = -h ]; then
    cat <<'HELP'
usage: launch_scripts/suite.sh [MACHINE [ROS ARGUMENTS ...]]

Starts twin_node, record_node and view_node for MACHINE (a name or the path of a machine file; tufting when not given), until
Ctrl-C. They listen on main_shaft/angle and balancing_torque/measured. ROS ARGUMENTS go to every node; a parameter of one node
takes that node's name before it:
  launch_scripts/suite.sh tufting -p twin_node:shaft:=lag -p record_node:bag:=out/monday -r __ns:=/machine_3
  launch_scripts/suite.sh looms/my_loom.yaml --params-file my_parameters.yaml
HELP
    exit
fi
machine="${1:-tufting}"
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

recording="out/recordings/$(date +%Y-%m-%d_%H-%M-%S)"
exec "$venv/bin/python" "$root/launch_scripts/bring_up.py" -- \
    "$venv/bin/twin_node" --ros-args -p "machine:=$machine" "${@:2}" --- \
    "$venv/bin/record_node" --ros-args -p "bag:=$recording" "${@:2}" --- \
    "$venv/bin/view_node" --ros-args -p "machine:=$machine" "${@:2}"
