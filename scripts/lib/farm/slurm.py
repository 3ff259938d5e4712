# SPDX-License-Identifier: Apache-2.0
"""Runs the commands of a Slurm cluster and reads their output. It does not deal with scans."""
import dataclasses
import os
import re
import shutil
import subprocess

from errors import GET_SLURM, USAGE, WRITE, FarmError

answer_s = 30  # slurmctld answers within its MessageTimeout, or not at all
# States of `squeue -t all` in which a task still waits or runs. A COMPLETING task has ended.
ACTIVE = {"PENDING", "CONFIGURING", "RUNNING", "SUSPENDED", "STOPPED", "REQUEUED", "REQUEUE_HOLD", "REQUEUE_FED", "RESIZING", "SIGNALING",
          "SPECIAL_EXIT", "STAGE_OUT"}
DEFAULTS = {"MaxArraySize": 1001, "MaxJobCount": 10000}


class NoAnswer(Exception):
    """slurmctld could not be reached, or refused a command; the text gives the reason."""


@dataclasses.dataclass(frozen=True)
class Task:
    job: str  # the array's number
    index: int
    state: str
    reason: str
    name: str

    @property
    def is_held(self):
        return self.state in ("REQUEUE_HOLD", "SPECIAL_EXIT") or (
            self.state == "PENDING" and ("held" in self.reason.lower() or self.reason in ("JobHeldUser", "JobHeldAdmin")))


@dataclasses.dataclass(frozen=True)
class Node:
    name: str
    state: str
    reason: str

    @property
    def is_out(self):
        """Whether the node takes no tasks until somebody returns it. A node that only does not respond may return by itself."""
        return self.state.startswith(("drain", "down", "fail"))


def ask(*command, text=None):
    try:
        done = subprocess.run([str(word) for word in command], input=text, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              timeout=answer_s, check=False, text=True)
    except subprocess.TimeoutExpired:
        raise NoAnswer(f"{command[0]}: no answer within {answer_s:g} s") from None
    if done.returncode != 0:
        raise NoAnswer(error_in(done.stderr) or f"{command[0]} ended with {done.returncode}")
    return done.stdout


def error_in(said):
    """The line that gives the reason, without the names of the program: the first that says so, because advice may follow it."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    line = next((line for line in lines if re.search(r"error|fatal|invalid|unrecognized", line, re.I)), lines[0] if lines else "")
    return re.sub(r"^(\w+: )?((error|fatal): )?(Batch job submission failed: )?", "", line)


def require():
    if shutil.which("sbatch") is None:
        raise FarmError(USAGE, f"sbatch: not found; run this where Slurm's commands are, or give --local-cluster N ({GET_SLURM})")


def not_there(reason):
    if "configuration source" in str(reason):
        return FarmError(USAGE, f"this machine has no configuration of Slurm ({reason}); set SLURM_CONF, or give --local-cluster N")
    return FarmError(WRITE, f"slurmctld does not answer ({reason}); give the same command again when it does")


def limits():
    """MaxArraySize (an index is below it) and MaxJobCount of the cluster."""
    said = ask("scontrol", "show", "config")
    found = dict(DEFAULTS)
    for name in found:
        match = re.search(rf"^{name}\s*=\s*(\d+)", said, re.M)
        if match:
            found[name] = int(match[1])
    return found


def processors(partition):
    """Processors of the nodes in service, from A/I/O/T of sinfo."""
    said = ask("sinfo", "-h", "-o", "%C", *(("-p", partition) if partition else ()))
    total = 0
    for word in said.split():
        numbers = word.split("/")
        if len(numbers) == 4 and all(n.isdigit() for n in numbers):
            total += int(numbers[3]) - int(numbers[2])
    return max(1, total)


def largest_node(partition):
    """The largest number of processors of a node; 0 if Slurm does not say it as a plain number."""
    said = ask("sinfo", "-h", "-N", "-o", "%c", *(("-p", partition) if partition else ()))
    return max((int(word.rstrip("+")) for word in said.split() if word.rstrip("+").isdigit()), default=0)


def nodes(partition):
    said = ask("sinfo", "-h", "-N", "-o", "%N|%T|%E", *(("-p", partition) if partition else ()))
    found = {}
    for line in said.splitlines():
        words = line.split("|", 2)
        if len(words) == 3:
            found[words[0]] = Node(words[0], words[1].lower(), words[2])
    return list(found.values())


def submit(script, *options):
    """Submits an array and returns its number."""
    return ask("sbatch", "--parsable", *options, text=script).strip().split(";")[0]


def tasks(prefix):
    """This user's array tasks whose job name begins with `prefix`, including those that ended in the last minutes."""
    said = ask("squeue", "-h", "-r", "-t", "all", "--user", os.getuid(), "-o", "%F|%K|%T|%j|%r")
    found = []
    for line in said.splitlines():
        words = line.split("|", 4)
        if len(words) == 5 and words[1].isdigit() and words[3].startswith(prefix):
            found.append(Task(words[0], int(words[1]), words[2], words[4], words[3]))
    return found
