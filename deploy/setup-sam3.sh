#!/bin/sh
# Install what the tests of backend sam3 need (torch for processors, transformers) into the virtual environment VENV.
# Bounded in time, and never fatal: without them those tests are skipped, and say so.
set -eu

venv=$1
limit_s=${2:-300}
cd "$(dirname "$0")/.."
end_s=$(($(date +%s) + limit_s))

pip_install() {
    left_s=$((end_s - $(date +%s)))
    [ "$left_s" -gt 0 ] || return 1
    timeout "$left_s" "$venv/bin/python" -m pip install -q --disable-pip-version-check -c constraints.txt "$@"
}

# The wheel of the usual index may bring 3 GB of CUDA along; the tests need none of it.
torch_brings_cuda() {
    pip_install --dry-run --report - torch 2>/dev/null | grep -Eqi '"name": *"(nvidia|cuda|triton)'
}

install() {
    if torch_brings_cuda; then
        pip_install --no-deps --index-url https://download.pytorch.org/whl/cpu torch || return 1
    else
        pip_install torch || return 1
    fi
    pip_install -e '.[sam3]'
}

if install && "$venv/bin/python" -c 'import torch, transformers'; then
    echo "Backend sam3 is installed, and will be tested."
else
    # Half of it would make the tests fail instead of skipping them.
    "$venv/bin/python" -m pip uninstall -q -y torch transformers >/dev/null 2>&1 || true
    echo "torch and transformers could not be installed within $limit_s s: tests of backend sam3 will be skipped." >&2
fi
