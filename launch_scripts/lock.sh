#!/usr/bin/env bash
# Regenerates the lock files from pyproject.toml: one version of each dependency for Python 3.11 to 3.14, with hashes.
# requirements.lock is what demonstration and suite run with; requirements-tests.lock the same with what tests and the docs
# site need; requirements-peers.lock what the bench compares with.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

uv="$(command -v uv || echo .venv/bin/uv)"
[ -x "$uv" ] || { echo "lock.sh: uv is not installed: .venv/bin/pip install uv" >&2; exit 2; }

lock() { # FILE EXTRA.. [-- OPTION..]
    local file="$1" extras=()
    shift
    while [ $# -gt 0 ] && [ "$1" != -- ]; do
        extras+=(--extra "$1")
        shift
    done
    "$uv" pip compile pyproject.toml "${extras[@]}" --universal --python-version 3.11 --fork-strategy fewest \
        --generate-hashes --no-emit-index-url --no-emit-find-links --no-header --no-annotate --quiet \
        --output-file "$file" "${@:2}"
}
lock requirements-tests.lock ros files view design plc logs cluster docs dev -- "$@"
lock requirements.lock ros files view design plc -- --constraint requirements-tests.lock # the same versions
lock requirements-peers.lock files design dev peers -- "$@"
