#!/usr/bin/env bash
# Prints an SROS2 policy for the suite of one machine: topics and services of each node; see --help.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
exec "$venv/bin/python" "$root/launch_scripts/policy.py" "$@"
