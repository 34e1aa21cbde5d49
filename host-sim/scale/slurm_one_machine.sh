#!/usr/bin/env bash
# Slurm on this machine alone, from Debian's slurm-wlm and munge, for tests: runs a command with it and ends it.
#
#     slurm_one_machine.sh FOLDER COMMAND...
#
# Everything lies in FOLDER. Exit code 77: it cannot run here; the last line states the reason.
set -euo pipefail
folder=$1
shift
cannot() {
    echo "skipped: $*"
    exit 77
}
[[ $(id -u) == 0 ]] || cannot "Slurm is started as root only"
for program in munged slurmctld slurmd sbatch; do
    command -v "$program" >/dev/null || cannot "no $program (Debian: apt-get install slurm-wlm munge)"
done
rm -rf "$folder"
mkdir -p "$folder/state" "$folder/spool"
folder=$(cd "$folder" && pwd)
host=$(hostname -s)

cat >"$folder/slurm.conf" <<CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmctldPort=26817
SlurmdPort=26818
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MpiDefault=none
ReturnToService=2
JobRequeue=1
SchedulerParameters=batch_sched_delay=0,sched_min_interval=0
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$folder/slurm.conf

processes=()
end() {
    for process in "${processes[@]}"; do
        kill "$process" 2>/dev/null || true
        wait "$process" 2>/dev/null || true
    done
}
trap end EXIT
(umask 077 && head --bytes=1024 /dev/urandom >"$folder/munge.key")
munged --foreground --force --num-threads=1 --key-file="$folder/munge.key" --socket="$folder/munge.socket" \
    --pid-file="$folder/munged.pid" --log-file="$folder/munged.log" --seed-file="$folder/munged.seed" \
    2>"$folder/munged.err" &
processes+=($!)
for _ in {1..50}; do [[ -S $folder/munge.socket ]] && break || sleep 0.1; done
slurmctld -D -i >"$folder/slurmctld.log" 2>&1 &
processes+=($!)
slurmd -D -N "$host" >"$folder/slurmd.log" 2>&1 &
processes+=($!)
for _ in {1..100}; do
    state=$(sinfo --noheader --format=%T 2>/dev/null || true)
    [[ $state == idle ]] && break
    sleep 0.2
done
if [[ $state != idle ]]; then
    tail -n 3 "$folder"/*.log "$folder"/*.err
    cannot "the node of Slurm does not become idle: ${state:-no answer}"
fi
"$@"
