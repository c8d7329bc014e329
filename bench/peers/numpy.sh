#!/usr/bin/env bash
# Times 1,000 conductivities from a NumPy array, and the same in Rust, in turns, on one core.
#   bench/peers/numpy.sh            compare, print the table
#   bench/peers/numpy.sh --write    and put it into docs/benchmarks.md
set -euo pipefail
cd "$(dirname "$0")/../.."
venv=bench/peers/.venv-example
[ -x "$venv/bin/python" ] || python3 -m venv "$venv"
"$venv/bin/pip" install --quiet --disable-pip-version-check --requirement bench/peers/requirements-example.txt ./dermis-python
cargo build --release --package dermis-bench
export RAYON_NUM_THREADS=1
exec "$venv/bin/python" bench/peers/numpy_many.py "$@"
