#!/bin/bash
# Tries simulate.slurm on this machine: Slurm with three nodes, one of which is killed while it computes. The requeued task
# finishes, and the files are those of one process. For root, with slurm-wlm and munge installed and `dermis` in PATH:
#   examples/cluster/try-slurm.sh
# It uses configuration and state in a temporary folder; a Slurm that this machine already runs is refused.
set -euo pipefail
cd "$(dirname "$0")"

design=skin16 samples=65536
options=(--samples "$samples" --seed 1)
for program in dermis munged slurmctld slurmd sbatch; do
  command -v "$program" >/dev/null || { echo "$program is missing" >&2; exit 2; }
done
[ "$(id -u)" = 0 ] || { echo "run it as root: slurmd starts jobs of other users" >&2; exit 2; }
if pgrep -x 'slurmctld|slurmd' >/dev/null; then echo "this machine runs Slurm already" >&2; exit 2; fi

here=$(mktemp -d)
chmod 755 "$here"
host=$(hostname -s)
declare -A node_pid
own_munge=
stop() {
  for pid in "${node_pid[@]}" "${controller-}" "$own_munge"; do
    [ -z "$pid" ] || kill -9 "$pid" 2>/dev/null || true
  done
  rm -rf "$here"
}
trap stop EXIT

# munge: the one that runs, or one of our own.
socket=/run/munge/munge.socket.2
if ! munge -n >/dev/null 2>&1; then
  socket=$here/munge.socket
  dd if=/dev/urandom of="$here/munge.key" bs=128 count=1 status=none
  chmod 400 "$here/munge.key"
  munged --foreground --force --key-file="$here/munge.key" --socket="$socket" --pid-file="$here/munge.pid" \
    --log-file="$here/munge.log" --seed-file="$here/munge.seed" &
  own_munge=$!
fi

mkdir -p "$here"/{state,n1,n2,n3}
cat > "$here/slurm.conf" <<CONF
ClusterName=try
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$socket
CryptoType=crypto/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmctldPort=26817
SlurmctldPidFile=$here/slurmctld.pid
SlurmctldLogFile=$here/slurmctld.log
StateSaveLocation=$here/state
SlurmdPidFile=$here/%n.pid
SlurmdLogFile=$here/%n.log
SlurmdSpoolDir=$here/%n
SlurmdParameters=config_overrides
SlurmdTimeout=10
KillWait=2
ReturnToService=2
MpiDefault=none
NodeName=n[1-3] NodeHostname=$host NodeAddr=127.0.0.1 Port=[26818-26820] CPUs=1 State=UNKNOWN
PartitionName=all Nodes=n[1-3] Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$here/slurm.conf
slurmctld -D -i >"$here/slurmctld.out" 2>&1 &
controller=$!
for node in n1 n2 n3; do
  slurmd -D -N "$node" >"$here/$node.out" 2>&1 &
  node_pid[$node]=$!
done
for _ in $(seq 60); do
  [ "$(sinfo -h -N -t idle -o %N 2>/dev/null | wc -l)" = 3 ] && break
  sleep 0.5
done
if [ "$(sinfo -h -N -t idle -o %N | wc -l)" != 3 ]; then
  sinfo -N -l || true
  tail -n 5 "$here"/*.log "$here"/*.out
  echo "Slurm does not start here" >&2
  exit 1
fi

echo "one process: $(dermis simulate $design -o "$here/one" "${options[@]}")"
dermis simulate --finish "$here/one"

job=$(sbatch --parsable --array=0-3 --cpus-per-task=1 --output="$here/task-%a.out" \
  --export=ALL simulate.slurm $design "$here/data" "${options[@]}")
until [ "$(find "$here/data" -name 'samples-*' 2>/dev/null | wc -l)" -ge 1 ]; do sleep 0.2; done
victim=$(squeue -h -j "$job" -t running -o %N | head -n 1)
echo "killed: $victim with task $(squeue -h -j "$job" -t running -w "$victim" -o %K), after $(find "$here/data" -name 'samples-*' | wc -l) files"

# As a machine that loses its power: slurmstepd first, so that nobody reports the end of the task.
on_victim() { tr '\0' '\n' <"/proc/$1/environ" 2>/dev/null | grep -qx "SLURMD_NODENAME=$victim"; }
program=$(for pid in $(pgrep -x dermis); do ! on_victim "$pid" || echo "$pid"; done)
[ -n "$program" ] || { echo "the task of $victim has ended already" >&2; exit 1; }
kill -9 "$(ps -o ppid= -p "$program" | tr -d ' ')" "${node_pid[$victim]}" "$program"
unset "node_pid[$victim]"

for _ in $(seq 600); do
  [ -z "$(squeue -h -j "$job")" ] && break
  sleep 1
done
grep -hs . "$here"/task-*.out || true
grep -hE "equeue.*JobId=$job|JobId=${job}_.*equeue|not responding|DOWN" "$here/slurmctld.log" | tail -n 5 || true
dermis simulate --finish "$here/data"

different=0
for file in "$here"/one/*; do cmp -s "$file" "$here/data/${file##*/}" || different=$((different + 1)); done
[ "$different" = 0 ] || { echo "$different files differ from those of one process" >&2; exit 1; }
echo "$(find "$here/one" -maxdepth 1 -type f | wc -l) files, all equal to those of one process"
