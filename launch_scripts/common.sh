# Sourced by the other scripts: makes .venv from a lock file when it is missing or out of date, and clears the way for the
# ROS wheels. A script that needs more than what runs (requirements.lock) names its lock before: lock=requirements-tests.lock.

root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
venv="$root/.venv"
ros_package="$root/ros2_ws/src/textile_twin_ros"
lock="${lock:-requirements.lock}"

fail() { echo "$(basename "$0"): $*" >&2; exit 2; }

is_suitable() { # PYTHON [MINOR]: whether it is 3.11 to 3.MINOR
    "$1" -c "import sys; sys.exit(not (3, 11) <= sys.version_info < (3, ${2:-14} + 1))" 2> /dev/null
}

# The first Python 3.11 to 3.13 that starts, else 3.14, for which there are no wheels of ROS: a name in PATH may be an
# empty shim.
find_python() {
    local name newest
    if [ -n "${PYTHON:-}" ] && is_suitable "$PYTHON"; then
        echo "$PYTHON"
        return
    fi
    for newest in 13 14; do
        for name in python3 python3.13 python3.12 python3.11 python3.14; do
            if is_suitable "$name" "$newest"; then
                echo "$name"
                return
            fi
        done
    done
    fail "Python 3.11 to 3.14 is needed, found $(python3 --version 2>&1 || true); install one, or name it: PYTHON=/path/to/python3.12 $0"
}

# Inputs of the environment: it is updated when one of these changes or when the folder has moved.
fingerprint() { # LOCK
    echo "$root" "$1"
    cat "$root"/{"$1",pyproject.toml} "$ros_package"/{setup.py,setup.cfg,pyproject.toml} | sha256sum
}

# An environment for the tests includes everything, so demonstration and suite reuse it unchanged.
is_made() {
    local made
    made="$(cat "$venv/.made_from" 2> /dev/null)" || return 1
    [ "$made" = "$(fingerprint "$lock")" ] || [ "$made" = "$(fingerprint requirements-tests.lock)" ]
}

# Shows the progress of pip on a terminal; its output goes to the log.
count_packages() {
    local total count=0 line
    total="$(grep -c '==' "$root/$lock")"
    while IFS= read -r line; do
        echo "$line" >> "$1"
        if [[ "$line" == Collecting* && -t 2 ]]; then
            count=$((count + 1))
            printf '\rSetting up %s: %d of up to %d packages' "${venv##*/}" "$count" "$total" >&2
        fi
    done
    if [ -t 2 ]; then printf '\r\033[K' >&2; fi
}

# Installs the lock file, which is complete, in two halves at once: pip uses one processor.
install_lock() { # OPTION..
    local half failed=0
    for half in 0 1; do
        awk -v half="$half" '/^[^ ]/ { entry++ } entry % 2 == half' "$root/$lock" |
            "$venv/bin/python" -m pip install --no-input --no-deps --require-hashes "$@" -r /dev/stdin &
    done
    wait -n || failed=1
    wait -n || failed=1
    return "$failed"
}

make_environment() (
    mkdir -p "$venv" "$root/out"
    exec 9<"$venv"
    flock 9 2>/dev/null || true # two scripts started at once: the second waits for the first
    local log="$root/out/setup.log"
    if is_made; then return; fi

    echo "Setting up ${venv##*/} from $lock (once; one to three minutes) ..." >&2
    if ! grep -qsF "$venv" "$venv/pyvenv.cfg" || ! is_suitable "$venv/bin/python"; then
        local python
        python="$(find_python)" || exit 2
        "$python" -m venv --clear "$venv" > "$log" 2>&1 || {
            cat "$log" >&2
            fail "$python cannot make a virtual environment; on Debian and Ubuntu: apt-get install python3-venv"
        }
    fi
    export PIP_DISABLE_PIP_VERSION_CHECK=1
    : > "$log"
    # The tests import a third of the modules: bytecode of all of them takes half a minute more. Services may run as a
    # user who cannot write it.
    local bytecode=--compile
    [ "$lock" = requirements-tests.lock ] && bytecode=--no-compile
    install_lock "$bytecode" 2>&1 | count_packages "$log" &&
        "$venv/bin/python" -m pip install --no-deps --no-build-isolation -e "$root" -e "$ros_package" \
            >> "$log" 2>&1 || {
        tail -n 15 "$log" >&2
        fail "the environment could not be made; the whole story is in $log"
    }
    fingerprint "$lock" > "$venv/.made_from"
)

# A ROS installation sourced in this shell would mix its libraries with those of the wheels.
unset PYTHONPATH PYTHONHOME LD_LIBRARY_PATH RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE
export AMENT_PREFIX_PATH="$venv"
# Hundreds of commands and nodes start: without written bytecode each would compile all modules again.
unset PYTHONDONTWRITEBYTECODE

make_environment || exit $?
