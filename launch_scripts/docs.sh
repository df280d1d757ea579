#!/usr/bin/env bash
# Builds the docs site into out/site, or the folder that is named, and prints the page to open: in a browser, with or
# without a network. Every warning, as of a link that leads nowhere, is an error. `docs.sh --serve` shows the site on this
# computer and follows changes.
set -euo pipefail
lock=requirements-tests.lock
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
export NO_MKDOCS_2_WARNING=1
mkdocs() { cd "$root" && "$venv/bin/python" -m mkdocs "$@"; }

case "${1:-}" in
    --serve) mkdocs serve --strict "${@:2}" ;;
    -*) fail "$1: there is --serve; without it the site is built" ;;
    *)
        site="$(realpath -m "${1:-$root/out/site}")"
        mkdocs build --quiet --strict --site-dir "$site"
        echo "$site/index.html"
        ;;
esac
