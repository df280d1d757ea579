#!/usr/bin/env bash
# Checks style, types and import contracts without running the code: a few seconds.
set -euo pipefail
lock=requirements-tests.lock
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
cd "$root"
export PATH="$venv/bin:$PATH"

check() {
    local output
    if output="$("$@" 2>&1)"; then echo "$*: passed"; else printf '%s\n%s: FAILED\n' "$output" "$*"; exit 1; fi
}
check ruff check --output-format concise
check ruff format --check --quiet
check mypy
check lint-imports
