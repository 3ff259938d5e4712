# SPDX-License-Identifier: Apache-2.0
"""The script of an array's tasks, each of which does one chunk. A task that ended well leaves a result file in the run's folder, since
Slurm's own record may be lost with slurmctld. A program that was killed, interrupted or could not write leaves no result, and its chunk
is tried again."""
import shlex

TEMPLATE = """\
#!/bin/sh
# Made by scripts/farm: some scans of a collection.
chunk={number}.$(({offset} + SLURM_ARRAY_TASK_ID))
run={run}
{command} --only "$run/names.$chunk" --jobs {jobs} --quiet >"$run/log.$chunk" 2>&1
code=$?
case $code in
  0 | 3) rm -f "$run/log.$chunk" ;;
  2) ;;
  *) exit "$code" ;;
esac
echo "$code" >"$run/new.$chunk.$SLURM_JOB_ID" && mv "$run/new.$chunk.$SLURM_JOB_ID" "$run/result.$chunk"
"""


def text(command, run, number, offset, jobs):
    return TEMPLATE.format(command=shlex.join(map(str, command)), run=shlex.quote(str(run)), number=number, offset=offset, jobs=jobs)
