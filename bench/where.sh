#!/usr/bin/env bash
# Where the time of the batched solver goes: samples of `perf`, by the stage that each one's instruction was written for.
#   bench/where.sh [CASE] [BATCHES]
# Once, on Debian: apt-get install linux-perf binutils
set -euo pipefail
cd "$(dirname "$0")/.."
case=${1:-cylinder30} batches=${2:-4000} program=target/profiling/dermis-bench
cargo build --quiet --profile profiling --package dermis-bench
folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT
perf record -q -e cpu-clock -F 4000 -o "$folder/data" "$program" serve "$case" "$folder" <<<"batched $batches" >"$folder/out"
perf script -i "$folder/data" --show-mmap-events -F comm,ip,sym,dso >"$folder/samples" 2>"$folder/messages"
python3 bench/where.py "$program" "$folder/samples"
