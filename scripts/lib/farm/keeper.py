# SPDX-License-Identifier: Apache-2.0
"""keeper.py FOLDER NODES: runs munged, slurmctld and NODES slurmd in FOLDER until its standard input ends, and restarts daemons that die.
Then it stops all of them and removes FOLDER.

It is a process of its own, so that the cluster is stopped however scripts/farm ends. It is the subreaper of all that it starts:
slurmstepd outlives slurmd, and a task its slurmstepd, but neither outlives the keeper. Writes "ready" once all nodes answer, or one
line that says what failed."""
import ctypes
import os
import pathlib
import re
import select
import shutil
import signal
import subprocess
import sys
import time

from slurm_conf import conf_text, free_ports, node_names

PR_SET_CHILD_SUBREAPER = 36
START_S = 30
ANSWER_S = 10
# A restarted slurmctld reads a state that may be seconds old and would assign the job numbers of these seconds again. slurmd refuses
# them ("Duplicate jobid") and its node drains. Each start therefore begins at numbers that no earlier one has assigned.
JOB_NUMBERS_PER_START = 100_000
# It also believes that tasks still run which have ended since. Nodes report their tasks when they register: at once, when slurmctld
# does not yet trust them (BatchStartTimeout + MessageTimeout), and then after 20 pings. A reconfiguration makes them register earlier.
REGISTER_S = 8
NO_ADDRESSES = ("getaddrinfo", "Address family not supported")
ONLY_LO = "; if this machine has no network but lo, give lo a second address: ip addr add 10.255.255.1/32 dev lo"


class StartError(Exception):
    pass


class Keeper:
    def __init__(self, folder, nodes):
        self.folder, self.nodes = folder, nodes
        self.conf = folder / "slurm.conf"
        self.environment = {**os.environ, "SLURM_CONF": str(self.conf)}
        self.running = {}  # name: process
        self.last_start = {}  # name: when
        self.controller_starts = 0
        self.register_at = None
        self.ports = []

    def command(self, name):
        run, log = self.folder / "run", self.folder / "log"
        if name == "munged":
            return ["munged", "--foreground", "--force", f"--socket={run}/munge.sock", f"--key-file={self.folder}/munge/key",
                    f"--log-file={log}/munged.log", f"--pid-file={run}/munged.pid", f"--seed-file={self.folder}/munge/seed",
                    "--num-threads=2"]
        if name == "slurmctld":
            return ["slurmctld", "-D", "-i", "-f", str(self.conf)]
        return ["slurmd", "-D", "-N", name, "-f", str(self.conf)]

    def start(self, name):
        if name == "slurmctld":
            self.write_conf()
            self.controller_starts += 1
        self.last_start[name] = time.monotonic()
        with open(self.folder / "log" / "start.log", "ab") as log:
            self.running[name] = subprocess.Popen(self.command(name), stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                                                  env=self.environment, start_new_session=True)

    def write_conf(self):
        text = conf_text(self.folder, self.ports, 1 + JOB_NUMBERS_PER_START * self.controller_starts)
        fresh = self.conf.with_suffix(".new")
        fresh.write_text(text)
        fresh.rename(self.conf)

    def prepare(self):
        for name in ("state", "log", "munge", "run", *(f"spool.{node}" for node in node_names(self.nodes))):
            (self.folder / name).mkdir(mode=0o755, exist_ok=True)
        # Nothing is limited here, and containers may have no cgroups. By default slurmd looks for them and does not start without. Until
        # version 22 the old plugin does not look for them as long as nothing is limited; since version 23 the plugin can be left out.
        version = re.search(r"(\d+)\.", self.ask("slurmd", "-V"))
        (self.folder / "cgroup.conf").write_text(f"CgroupPlugin={'disabled' if version and int(version[1]) >= 23 else 'cgroup/v1'}\n")
        key = self.folder / "munge" / "key"
        key.touch(mode=0o600)
        key.write_bytes(os.urandom(1024))

    def ask(self, *command):
        try:
            done = subprocess.run(command, env=self.environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                  stderr=subprocess.DEVNULL, timeout=ANSWER_S, check=False, text=True)
        except subprocess.TimeoutExpired:
            return ""
        return done.stdout if done.returncode == 0 else ""

    def start_all(self):
        self.prepare()
        self.ports = free_ports(1 + self.nodes)
        self.start("munged")
        self.wait_for("munged", lambda: (self.folder / "run" / "munge.sock").exists())
        self.start("slurmctld")
        for node in node_names(self.nodes):
            self.start(node)
        self.wait_for("slurmctld", lambda: len(self.ask("sinfo", "-h", "-N", "-t", "idle", "-o", "%N").split()) == self.nodes)

    def wait_for(self, name, is_ready):
        end = time.monotonic() + START_S
        while not is_ready():
            dead = next((n for n, process in self.running.items() if process.poll() is not None), None)
            if dead or time.monotonic() > end:
                raise StartError(f"{dead or name} did not start: {self.last_line(dead)}")
            time.sleep(0.05)

    def last_line(self, dead):
        for file in (f"slurmd.{dead}.log", "start.log", "slurmctld.log"):
            lines = [line for line in (self.folder / "log" / file).read_text(errors="replace").splitlines() if line.strip()] \
                if (self.folder / "log" / file).exists() else []
            errors = [re.sub(r"^\[[^]]*\] ", "", line) for line in lines if "rror" in line or "atal" in line]
            if errors:
                # The first error is the cause, and the last one what followed from it.
                said = "; ".join(dict.fromkeys((errors[0], errors[-1])))
                return said + (ONLY_LO if any(sign in said for sign in NO_ADDRESSES) else "")
        return f"no answer within {START_S} s"

    def watch(self):
        """Restarts dead daemons until standard input ends."""
        while not select.select([sys.stdin], [], [], 0.1)[0]:
            self.reap()
            for name, process in list(self.running.items()):
                if process.returncode is not None and time.monotonic() - self.last_start[name] > 1:
                    self.start(name)
                    self.register_at = time.monotonic() + REGISTER_S
            if self.register_at and time.monotonic() > self.register_at:
                self.register_at = None
                self.ask("scontrol", "reconfigure")

    def reap(self):
        """Collects ended children, also orphans that became children of this process."""
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            for process in self.running.values():
                if process.pid == pid:
                    process.returncode = os.waitstatus_to_exitcode(status)

    def take_down(self):
        """Stops slurmstepd first, through Slurm, since it outlives slurmd, then all other processes."""
        if self.running:
            self.ask("scancel", "--user", str(os.getuid()))
            end = time.monotonic() + 3
            while time.monotonic() < end and self.ask("squeue", "-h", "-o", "%A"):
                time.sleep(0.1)
        self.running = {name: process for name, process in self.running.items() if process.returncode is None}
        for sign, patience_s in ((signal.SIGTERM, 3), (signal.SIGKILL, 10)):
            end = time.monotonic() + patience_s
            while (pids := descendants(os.getpid())) and time.monotonic() < end:
                for pid in pids:
                    try:
                        os.kill(pid, sign)
                    except ProcessLookupError:
                        pass
                time.sleep(0.1)
                self.reap()


def descendants(root):
    """The descendants of the process `root`, without zombies."""
    children = {}
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
        except OSError:
            continue
        if state != "Z":
            children.setdefault(int(parent), []).append(int(stat.parent.name))
    found, todo = [], [root]
    while todo:
        todo += (below := children.get(todo.pop(), []))
        found += below
    return found


def main():
    for sign in (signal.SIGINT, signal.SIGHUP):
        signal.signal(sign, signal.SIG_IGN)  # the terminal's; scripts/farm closes the pipe
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        print("prctl: this kernel has no subreapers", flush=True)
        return 1
    keeper = Keeper(pathlib.Path(sys.argv[1]), int(sys.argv[2]))
    try:
        keeper.start_all()
        print("ready", flush=True)
        keeper.watch()
    except (StartError, OSError) as error:
        print(error, flush=True)
        return 1
    finally:
        keeper.take_down()
        shutil.rmtree(keeper.folder, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
