#!/usr/bin/env bash
# Runs the steps of pyEIT's example of dynamic imaging (eit_dynamic_jac.py) with pyEIT and with dermis, in one run, on one core.
#   bench/peers/example.sh            compare, print the tables
#   bench/peers/example.sh --write    and put them into docs/benchmarks.md
set -euo pipefail
cd "$(dirname "$0")/../.."
venv=bench/peers/.venv-example
[ -x "$venv/bin/python" ] || python3 -m venv "$venv"
"$venv/bin/pip" install --quiet --disable-pip-version-check --requirement bench/peers/requirements-example.txt ./dermis-python
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 RAYON_NUM_THREADS=1
exec "$venv/bin/python" -W ignore bench/peers/example.py "$@"
