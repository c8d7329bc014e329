#!/usr/bin/env bash
# Times dermis' networks beside PyTorch (training, one frame) and ONNX Runtime (one frame), in one run.
#   bench/peers/learn.sh            compare, print the tables
#   bench/peers/learn.sh --write    and put them into docs/benchmarks.md
# PyTorch's wheel brings libraries for GPUs that nothing here uses (5 GB); one without them serves as well.
set -euo pipefail
cd "$(dirname "$0")/../.."
venv=bench/peers/.venv-learn
if ! "$venv/bin/python" -c 'import numpy, onnx, onnxruntime, torch' 2>/dev/null; then
  python3 -m venv "$venv"
  "$venv/bin/pip" install --quiet --requirement bench/peers/requirements-learn.txt
fi
cargo build --release --package dermis-bench --package dermis-cli
exec "$venv/bin/python" bench/peers/learn.py "$@"
