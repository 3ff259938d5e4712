#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# array.sh COLLECTION.json STORE [TASKS]: brings a store up to date by a Slurm job array of TASKS tasks (default 16), one shard each.
# It submits the array again, at most five times, while scans are stale, and then names those that failed. Exit code 0, or 3 if a
# scan is still stale or a failure is new. Options of sbatch: SBATCH_PARTITION, SBATCH_TIMELIMIT and so on; of trocar-mesh: none.
# TROCAR_MESH is the program on the nodes; PAUSE_S the time before a repetition (default 30 s). The tasks write errors to STORE.log.
set -uo pipefail
(($# == 2 || $# == 3)) || { echo "usage: array.sh COLLECTION.json STORE [TASKS]" >&2 && exit 2; }
batch=("${TROCAR_MESH:-trocar-mesh}" batch "$1" -o "$2")

if [[ ${SLURM_ARRAY_TASK_ID-} ]]; then # a task
  exec "${batch[@]}" --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --jobs "${SLURM_CPUS_PER_TASK:-1}" --quiet
fi

# Reads the last line of a dry run: "3 of 200 scans are stale, 2 are known failures".
look() {
  local line
  line=$("${batch[@]}" --dry-run | tail -n 1) || exit
  read -r stale _ scans _ _ _ known _ <<<"$line"
}
look
known_before=${known:-0}
for round in {1..6}; do
  ((stale > 0)) || break
  ((round == 1)) || sleep "${PAUSE_S:-30}"
  tasks=$((stale < ${3:-16} ? stale : ${3:-16}))
  echo "round $round: $stale of $scans scans are stale, $tasks tasks"
  sbatch --quiet --wait --requeue --job-name=trocar --array="0-$((tasks - 1))" --output="$2.log" --open-mode=append "$0" "$@"
  look
done
"${batch[@]}" --dry-run # names the scans that failed, and why
((stale == 0 && ${known:-0} <= known_before)) || exit 3
