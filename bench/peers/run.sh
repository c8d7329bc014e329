#!/usr/bin/env bash
# Times dermis beside CHOLMOD (through scikit-sparse), SciPy, scikit-fem and pyEIT: same meshes, same conductivities, same
# run, one core and two.
#   bench/peers/run.sh            compare, print the tables
#   bench/peers/run.sh --write    and put them into docs/benchmarks.md
# Once, on Debian: apt-get install python3-venv python3-dev gcc libsuitesparse-dev libopenblas0-pthread
set -euo pipefail
cd "$(dirname "$0")/../.."
venv=bench/peers/.venv
if ! "$venv/bin/python" -c 'import sksparse.cholmod, pyeit, skfem' 2>/dev/null; then
  python3 -m venv "$venv"
  "$venv/bin/pip" install --quiet --requirement bench/peers/requirements.txt
fi
cargo build --release --package dermis-bench
# compare.py keeps every program on the last core that this process may use, on the last two where two work side by side;
# no library may start threads of its own.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 RAYON_NUM_THREADS=1
exec "$venv/bin/python" bench/peers/compare.py "$@"
