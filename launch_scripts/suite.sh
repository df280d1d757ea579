#!/usr/bin/env bash
# Starts the suite beside a machine, without a ROS installation; see --help.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
exec "$venv/bin/python" "$root/launch_scripts/suite.py" "$@"
