#!/usr/bin/env bash
# A whole Slurm on this one machine, for tests: scripts/slurm_node.sh up|down|status [folder]
#
# "up" installs what is missing (Debian, as root), starts munged, slurmctld and slurmd without systemd, and prints the
# line that makes sbatch and squeue of a shell use them: eval "$(scripts/slurm_node.sh up)". "down" cancels all jobs,
# ends the three and removes the folder. All that they write lies in the folder; a Slurm of the system is left alone.
# GPUS=<n> gives the node so many pretended GPUs: Slurm hands them out, nothing can compute on them.
set -euo pipefail

command=${1:-}
folder=$(realpath -m "${2:-/tmp/ctus-slurm}")
gpus=${GPUS:-0}
export SLURM_CONF=$folder/slurm.conf

fail() { printf 'slurm_node: %s\n' "$1" >&2; exit 1; }

installed() { command -v slurmctld >/dev/null && command -v slurmd >/dev/null && command -v munged >/dev/null; }

install_missing() {
  installed && return
  command -v apt-get >/dev/null || fail "expected slurmctld, slurmd and munged or apt-get to install them, found none"
  # The packages would start services of the system; nothing of theirs is wanted here.
  export DEBIAN_FRONTEND=noninteractive RUNLEVEL=1
  apt-get install -y --no-install-recommends slurm-wlm munge >&2 ||
    { apt-get update >&2 && apt-get install -y --no-install-recommends slurm-wlm munge >&2; }
  installed || fail "expected slurmctld, slurmd and munged after installing slurm-wlm and munge, found them missing"
}

free_port() {
  python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'
}

write_configuration() {
  local host cpus memory
  host=$(hostname -s)
  cpus=$(nproc)
  memory=$(awk '/MemTotal/ {print int($2 / 1024 * 0.9)}' /proc/meminfo)
  cat >"$folder/slurm.conf" <<CONF
ClusterName=ctus
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
# A container lets nobody make control groups.
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=2
JobAcctGatherParams=OverMemoryKill
AccountingStorageType=accounting_storage/none
MpiDefault=none
SchedulerType=sched/backfill
SchedulerParameters=sched_min_interval=200000,batch_sched_delay=0
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
DefMemPerCPU=512
ReturnToService=2
KillWait=5
MinJobAge=600
MaxArraySize=1001
GresTypes=gpu
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cpus RealMemory=$memory Gres=gpu:$gpus State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE OverSubscribe=NO State=UP
CONF
  : >"$folder/gres.conf"
  for ((number = 0; number < gpus; number++)); do
    # A device file that is there is all that Slurm asks of a GPU.
    mknod "$folder/gpu$number" c 1 3
    printf 'NodeName=%s Name=gpu File=%s\n' "$host" "$folder/gpu$number" >>"$folder/gres.conf"
  done
}

start_all() {
  mkdir -p "$folder/state" "$folder/spool" "$folder/munge"
  chmod 755 "$folder"
  chown root:root "$folder" "$folder/munge"
  (umask 077 && head -c 1024 /dev/urandom >"$folder/munge/munge.key")
  munged --socket="$folder/munge.socket" --key-file="$folder/munge/munge.key" --pid-file="$folder/munge/munged.pid" \
    --log-file="$folder/munge/munged.log" --seed-file="$folder/munge/munged.seed" --force 2>>"$folder/munge/said"
  slurmctld -c >>"$folder/slurmctld.log" 2>&1
  slurmd -c >>"$folder/slurmd.log" 2>&1
}

wait_for_node() {
  for _ in $(seq 100); do
    [ "$(sinfo -h -o %T 2>/dev/null)" = idle ] && return
    sleep 0.2
  done
  tail -n 20 "$folder"/slurm*.log >&2
  fail "expected the node to be idle within 20 s, received: $(sinfo -h -o '%T %E' 2>&1 | head -n 1)"
}

end_process() {
  local pid
  [ -f "$1" ] || return 0
  pid=$(cat "$1")
  kill "$pid" 2>/dev/null || return 0
  for _ in $(seq 50); do
    kill -0 "$pid" 2>/dev/null || return 0
    sleep 0.1
  done
  kill -9 "$pid" 2>/dev/null || true
}

up() {
  [ "$(id -u)" = 0 ] || fail "expected root, which slurmd must be, received user $(id -un)"
  if [ -f "$folder/slurm.conf" ] && sinfo -h >/dev/null 2>&1; then
    printf 'export SLURM_CONF=%s\n' "$SLURM_CONF"
    return
  fi
  [ ! -e "$folder" ] || down
  install_missing
  mkdir -p "$folder"
  write_configuration
  start_all
  wait_for_node
  printf 'export SLURM_CONF=%s\n' "$SLURM_CONF"
}

down() {
  [ -e "$folder" ] || return 0
  [ -f "$folder/slurm.conf" ] || fail "expected the folder of a Slurm that this started, received $folder"
  if sinfo -h >/dev/null 2>&1; then
    scancel --user=root --full 2>/dev/null || true
    for _ in $(seq 75); do
      [ -z "$(squeue -h 2>/dev/null)" ] && break
      sleep 0.2
    done
  fi
  end_process "$folder/slurmd.pid"
  end_process "$folder/slurmctld.pid"
  end_process "$folder/munge/munged.pid"
  rm -rf "$folder"
}

case $command in
  up) up ;;
  down) down ;;
  status) sinfo 2>/dev/null || fail "expected a Slurm that was started with: scripts/slurm_node.sh up $folder" ;;
  *) fail "expected up, down or status, received '$command'" ;;
esac
