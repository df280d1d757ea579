#!/usr/bin/env bash
# Checks everything: style, types, the order of the packages, then the tests. Arguments go to pytest: -m "not slow" for
# the quicker ones, --all for the repetitions with more seeds and machines too, -n 0 for one after the other.
set -euo pipefail
lock=requirements-tests.lock
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
cd "$root"

# Installs the drawing packages of some tests if permitted; these tests skip otherwise, with the reason. The viewer draws
# without a display or a graphics card by Mesa's software Vulkan, and the design page runs in Chromium.
offer() { # WHAT-FOR PACKAGE..
    echo "Installing ${*:2}, $1 ..." >&2
    install() { apt-get install -y -qq --no-install-recommends "$@" > /dev/null 2>&1; }
    install "${@:2}" || { apt-get update -qq > /dev/null 2>&1 && install "${@:2}"; } ||
        echo "it could not be installed: the tests that need it will skip" >&2
}
if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    compgen -G '/usr/share/vulkan/icd.d/lvp_icd*' > /dev/null ||
        offer "to draw without a screen" mesa-vulkan-drivers libvulkan1
    { command -v chromium && command -v chromedriver; } > /dev/null ||
        offer "to use the design page in a browser" chromium chromium-driver
fi

# Isolate the tests from the user's settings and from the network.
scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT
export HOME="$scratch" ROS_LOG_DIR="$scratch/ros_log" ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_PYTHON_CHECK_FIELDS=1
export PATH="$venv/bin:$PATH" MPLBACKEND=agg
# Compiled loops are cached for the other tests and for the next run.
export TEXTILE_TWIN_CACHE_DIR="${TEXTILE_TWIN_CACHE_DIR:-$root/out/compiled}"

# The loops that most tests need, of shaft estimators and contact, compile in parallel with the checks.
"$venv/bin/python" - > /dev/null 2>&1 <<'COMPILE' &
import numpy as np
import textile_twin_core as ttc
from textile_twin_core.shaft import create_estimator
for shaft in ("causal", "lag", "smooth"):
    estimator = create_estimator(shaft)
    estimator.step(np.arange(200) / 500.0, np.arange(200) * 0.03)
    estimator.finish()
    session = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"]).session(shaft=shaft)
    session.step(np.arange(200) * 2_000_000, np.arange(200) * 0.03)
    session.finish()
needles = ttc.compile(ttc.machines.needle_transfer()).session(shaft="causal")
needles.step(np.arange(200) * 2_000_000, np.arange(200) * 0.05)
COMPILE
compiling=$!

launch_scripts/checks.sh
wait "$compiling" || true
# Tests run in parallel, one more than there are processors: those that tests/conftest.py puts in one group often wait.
python -m pytest -n "$(($(nproc) + 1))" "$@"
