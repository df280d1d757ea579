#!/usr/bin/env bash
# Prints an SROS2 policy for the suite of one machine: what each of its nodes may publish, hear and offer; --help tells more.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
exec "$venv/bin/python" "$root/launch_scripts/policy.py" "$@"
