#!/bin/sh
# Make a virtual environment with the package (editable) and its development tools, pinned to what was tested.
# Installs Debian's packages that are missing where it may (as root); says which ones to install where it may not.
set -eu

venv=$1
cd "$(dirname "$0")/.."

missing=""
python=""
for candidate in python3.11 python3.12 python3.13 python3; do
    if command -v "$candidate" >/dev/null 2>&1 &&
        "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
        python=$candidate
        break
    fi
done
[ -n "$python" ] || missing="$missing python3"
{ [ -n "$python" ] && "$python" -c 'import ensurepip, venv' 2>/dev/null; } || missing="$missing python3-venv"
# The tests let systemd itself judge the units.
command -v systemd-analyze >/dev/null 2>&1 || missing="$missing systemd"

if [ -n "$missing" ]; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
        apt-get update -q
        # shellcheck disable=SC2086 -- a list of package names
        DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends $missing
    elif [ "$missing" != " systemd" ]; then
        echo "Please install these packages first:$missing" >&2
        exit 1
    fi
    [ -n "$python" ] || python=python3
fi

[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
"$venv/bin/python" -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[dev]'
