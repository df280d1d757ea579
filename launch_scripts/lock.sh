#!/usr/bin/env bash
# Writes requirements.lock anew from pyproject.toml: one version of each dependency for Python 3.11 to 3.13, with hashes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

uv="$(command -v uv || echo .venv/bin/uv)"
[ -x "$uv" ] || { echo "lock.sh: uv is not installed: .venv/bin/pip install uv" >&2; exit 2; }
"$uv" pip compile pyproject.toml --all-extras --universal --python-version 3.11 --fork-strategy fewest \
    --generate-hashes --no-emit-index-url --no-emit-find-links --no-header --no-annotate --quiet \
    --output-file requirements.lock "$@"
