# SPDX-License-Identifier: Apache-2.0
"""A Slurm cluster on this machine: munged, slurmctld and N slurmd with one processor each, in a folder of their own, without cgroups and
without root's rights.

Run as a program (local_slurm.py FOLDER NODES), it is the cluster's keeper until its standard input ends: it restarts daemons that die, and
does what an administrator does after a crash. It is the subreaper of all that it starts (slurmstepd outlives slurmd, and a task its
slurmstepd), so that nothing of a cluster is left, however the test ends."""
import contextlib
import ctypes
import getpass
import os
import pathlib
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

PR_SET_CHILD_SUBREAPER = 36
START_S = 30
ADMINISTRATION_S = 2
REGISTER_S = 8  # after a restart: slurmctld does not trust the nodes before (BatchStartTimeout + MessageTimeout)
# slurmctld restarts with a state that may be seconds old and would assign the numbers of jobs again, which slurmd refuses ("Duplicate
# jobid"). Each start begins at numbers that no earlier one has assigned.
JOBS_PER_START = 100_000
PATH = os.environ.get("PATH", "") + ":/usr/sbin:/sbin"  # where Debian keeps the daemons
# A requeue waits for cred_expire (120 s by default), and a dead slurmctld's tasks for SlurmdTimeout: short, since all is near.
CONF = """\
ClusterName=trocar
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.sock,cred_expire=5
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=5,bf_interval=5,batch_sched_delay=0
ReturnToService=2
SlurmdTimeout=5
SlurmctldTimeout=10
MessageTimeout=3
BatchStartTimeout=3
KillWait=2
MinJobAge=60
FirstJobId={first_job}
JobRequeue=1
MpiDefault=none
SwitchType=switch/none
SlurmdParameters=config_overrides
DebugFlags=NO_CONF_HASH
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def is_installed():
    return all(shutil.which(name, path=PATH) for name in ("munged", "slurmctld", "slurmd", "sbatch", "scontrol"))


def processes():
    """pid: (parent, command line), of all that run."""
    out = {}
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            state, parent = (folder / "stat").read_text().rpartition(")")[2].split()[:2]
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if state != "Z":
            out[int(folder.name)] = (int(parent), command)
    return out


def descendants(root):
    known, found, todo = processes(), {}, [root]
    while todo:
        parent = todo.pop()
        below = {pid: command for pid, (its_parent, command) in known.items() if its_parent == parent}
        found.update(below)
        todo += below
    return found


class LocalSlurm:
    """The cluster of the keeper, as in `with LocalSlurm(3) as cluster`. `environment` leads Slurm's commands to it."""

    def __init__(self, nodes):
        self.nodes = nodes
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="trocar-slurm."))
        self.environment = {**os.environ, "PATH": PATH, "SLURM_CONF": str(self.folder / "slurm.conf")}
        self.keeper = None

    def __enter__(self):
        self.folder.chmod(0o755)  # munged and slurmd require it
        self.keeper = subprocess.Popen([sys.executable, "-B", __file__, self.folder, str(self.nodes)], stdin=subprocess.PIPE,
                                       stdout=subprocess.PIPE, text=True, env=self.environment, start_new_session=True)
        said = self.keeper.stdout.readline().strip()
        if said != "ready":
            self.__exit__()
            raise RuntimeError(said or "the cluster did not start")
        return self

    def __exit__(self, *_):
        self.keeper.stdin.close()
        self.keeper.wait()
        self.keeper.stdout.close()

    def victims(self, kind):
        """The processes of a kind: "slurmctld", "slurmd", or "task", the processes that slurmstepd starts."""
        below = descendants(self.keeper.pid)
        steps = {pid for pid, command in below.items() if command.startswith("slurmstepd: [")}
        if kind == "task":
            return [pid for pid, (parent, _) in processes().items() if parent in steps]
        return [pid for pid, command in below.items() if command.startswith(f"{kind} -D")]


class Keeper:
    def __init__(self, folder, nodes):
        self.folder = folder
        self.nodes = [f"n{k + 1}" for k in range(nodes)]
        self.running, self.started, self.starts_of_controller, self.register_at = {}, {}, 0, float("inf")
        with contextlib.ExitStack() as stack:
            sockets = [stack.enter_context(socket.socket()) for _ in range(1 + nodes)]
            for one in sockets:
                one.bind(("127.0.0.1", 0))
            self.ports = [one.getsockname()[1] for one in sockets]

    def start(self, name):
        folder = self.folder
        if name == "slurmctld":
            host = socket.gethostname().split(".")[0]
            text = CONF.format(host=host, ports=self.ports, user=getpass.getuser(), folder=folder, first_job=1 + JOBS_PER_START * self.starts_of_controller)
            text += "".join(f"NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs=1 RealMemory=1000 State=UNKNOWN\n"
                            for node, port in zip(self.nodes, self.ports[1:]))
            (folder / "slurm.new").write_text(text)
            (folder / "slurm.new").rename(folder / "slurm.conf")
            self.starts_of_controller += 1
        command = {"munged": ["munged", "--foreground", "--force", f"--socket={folder}/munge.sock", f"--key-file={folder}/key",
                              f"--log-file={folder}/munged.log", f"--pid-file={folder}/munged.pid", f"--seed-file={folder}/seed"],
                   "slurmctld": ["slurmctld", "-D", "-i"]}.get(name, ["slurmd", "-D", "-N", name])
        with open(folder / "start.log", "ab") as log:
            self.running[name] = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
        self.started[name] = time.monotonic()

    def ask(self, *command):
        try:
            return subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=10, check=False, text=True).stdout
        except subprocess.TimeoutExpired:
            return ""

    def start_all(self):
        for name in ("state", *(f"spool.{node}" for node in self.nodes)):
            (self.folder / name).mkdir(mode=0o755)
        # Until version 22 the old plugin does not look for cgroups as long as nothing is limited; since 23 it can be left out.
        version = re.search(r"(\d+)\.", self.ask("slurmd", "-V"))
        (self.folder / "cgroup.conf").write_text(f"CgroupPlugin={'disabled' if version and int(version[1]) >= 23 else 'cgroup/v1'}\n")
        (self.folder / "key").touch(mode=0o600)
        (self.folder / "key").write_bytes(os.urandom(1024))
        self.start("munged")
        self.wait_for((self.folder / "munge.sock").exists)
        for name in ("slurmctld", *self.nodes):
            self.start(name)
        self.wait_for(lambda: len(self.ask("sinfo", "-h", "-N", "-t", "idle", "-o", "%N").split()) == len(self.nodes))

    def wait_for(self, is_ready):
        end = time.monotonic() + START_S
        while not is_ready():
            self.reap()
            if time.monotonic() > end or any(process.returncode is not None for process in self.running.values()):
                logs = "".join(file.read_text(errors="replace") for file in sorted(self.folder.glob("*.log")))
                sys.exit("; ".join(dict.fromkeys(line for line in logs.splitlines() if re.search("error|fatal", line, re.I))) or "no answer")
            time.sleep(0.05)

    def watch(self):
        administer_at = time.monotonic() + ADMINISTRATION_S
        while not select.select([sys.stdin], [], [], 0.1)[0]:
            self.reap()
            for name, process in list(self.running.items()):
                if process.returncode is not None and time.monotonic() - self.started[name] > 1:
                    self.start(name)
                    self.register_at = time.monotonic() + REGISTER_S
            if time.monotonic() > administer_at:
                self.administer()
                administer_at = time.monotonic() + ADMINISTRATION_S

    def administer(self):
        """Returns drained nodes to service and releases held tasks. A slurmctld that has restarted believes that tasks still run which have
        ended since. Nodes report their tasks when they register, which a reconfiguration makes them do."""
        for line in self.ask("sinfo", "-h", "-N", "-o", "%N|%T").splitlines():
            if "drain" in line or "down" in line:
                self.ask("scontrol", "update", f"nodename={line.partition('|')[0]}", "state=resume")
        for line in self.ask("squeue", "-h", "-r", "-t", "all", "-o", "%i|%T|%r").splitlines():
            job, state, reason = line.split("|", 2)
            if state in ("REQUEUE_HOLD", "SPECIAL_EXIT") or "held" in reason.lower():
                self.ask("scontrol", "release", job)
        if time.monotonic() > self.register_at:
            self.register_at = float("inf")
            self.ask("scontrol", "reconfigure")

    def reap(self):
        """Collects ended children, also orphans that became children of this process."""
        with contextlib.suppress(ChildProcessError):
            while (ended := os.waitpid(-1, os.WNOHANG))[0] != 0:
                for process in self.running.values():
                    if process.pid == ended[0]:
                        process.returncode = os.waitstatus_to_exitcode(ended[1])

    def take_down(self):
        self.ask("scancel", "--user", str(os.getuid()))
        for sign, patience_s in ((signal.SIGTERM, 3), (signal.SIGKILL, 10)):
            end = time.monotonic() + patience_s
            while (found := descendants(os.getpid())) and time.monotonic() < end:
                for pid in found:
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(pid, sign)
                time.sleep(0.1)
                self.reap()


def main():
    for sign in (signal.SIGINT, signal.SIGHUP):
        signal.signal(sign, signal.SIG_IGN)  # the terminal's; the test closes the pipe
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    assert ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) == 0
    keeper = Keeper(pathlib.Path(sys.argv[1]), int(sys.argv[2]))
    try:
        keeper.start_all()
        print("ready", flush=True)
        keeper.watch()
    except SystemExit as reason:
        print(reason, flush=True)
    finally:
        keeper.take_down()
        shutil.rmtree(keeper.folder, ignore_errors=True)


if __name__ == "__main__":
    main()
