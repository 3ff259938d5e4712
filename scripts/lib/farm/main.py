# SPDX-License-Identifier: Apache-2.0
"""scripts/farm: arguments, exit codes, and what is printed."""
import argparse
import json
import os
import pathlib
import shlex
import signal
import sys
import threading

import metrics
import plan
import program
import run
import slurm
import summary
import watch
from cluster import NODES_MAX, LocalCluster
from errors import DONE, GET_SLURM, NAME, REFUSED, USAGE, VERSION, WRITE, FarmError

ROOT = pathlib.Path(__file__).resolve().parents[3]
OWN_POLL_S, POLL_S = 0.5, 3
OF_BATCH = ("--dry-run", "--explain", "--verify", "--rehash", "--only", "--shard", "--gc", "--prune", "--grace")


def say(message):
    print(f"{os.path.basename(NAME)}: {message}", file=sys.stderr, flush=True)


class Parser(argparse.ArgumentParser):
    def error(self, message):
        of_batch = next((option for option in OF_BATCH if message.startswith("unrecognized") and option in message.split()), None)
        raise FarmError(USAGE, f"{of_batch}: is an option of trocar-mesh batch; give it to that program, with the same collection and store"
                        if of_batch else f"{message}; {NAME} --help")


def number(kind, low, high):
    def read(text):
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text}: must be a number from {low} to {high}")
        return value
    return read


def numbers(kind, low, high):
    return lambda text: [number(kind, low, high)(word) for word in text.split(",")]


def arguments(words):
    parser = Parser(prog=NAME, formatter_class=argparse.RawDescriptionHelpFormatter, description="""\
Makes the assets (meshes) of the stale (new or changed) scans of a collection on a Slurm cluster, and keeps them in a
folder, the store. The computers of the cluster are its nodes. The work is divided into tasks: a task meshes some of the scans on one node.
`trocar-mesh batch COLLECTION -o STORE` does the same on one machine. If you give the command again, it makes only what is still missing.""", epilog=f"""\
examples:
  {NAME} scans.json -o /shared/store
  {NAME} scans.json -o store --local-cluster 3     the same on a cluster on this machine; needs Slurm ({GET_SLURM})
  {NAME} --local-cluster 3                         starts only the cluster; Ctrl-C ends it
  {NAME} --plan scans.json --nodes 20 --scans 1e6  prints time, bytes, and which resource limits the speed
COLLECTION, STORE and the program must have the same paths on every node. During a run, the folder
STORE.farm beside the store holds the state of the run. A known failure is a scan that failed in an earlier run and has not changed since.
exit codes: 0 done, apart from known failures; 2 wrong usage; 3 a scan failed or could not be finished; 4 interrupted, not writable, or the
cluster did not answer (give the command again); 1 an internal error.""")
    parser.add_argument("collection", nargs="?", metavar="COLLECTION.json", help="the collection: a file with scans and their parameters, as for trocar-mesh batch")
    parser.add_argument("-o", dest="store", metavar="STORE", help="the store: the folder that keeps all results")
    parser.add_argument("--local-cluster", type=number(int, 1, NODES_MAX), metavar="N", dest="local",
                        help="start a Slurm cluster of N nodes on this machine (the programs munged, slurmctld and N slurmd). The cluster ends with the run")
    parser.add_argument("--program", metavar="PATH", help="path of trocar-mesh on the nodes (default: the one built in this clone of the repository, if there is one, else the one in PATH)")
    parser.add_argument("--chunk", type=number(float, 1, 86400), default=60, metavar="S", help="give a task as many scans as take about S seconds (default: 60)")
    parser.add_argument("--jobs", type=number(int, 1, 1024), default=1, metavar="N", help="number of processors and threads of each task (default: 1)")
    parser.add_argument("--throttle", type=number(int, 1, 1 << 20), default=0, metavar="K", help="run at most K tasks at once (default: no limit)")
    parser.add_argument("--time-limit", type=number(int, 1, 100000), default=0, metavar="MIN", dest="limit",
                        help="time limit of a task, minutes; it is doubled for each further try (default: 10 times the estimated time of the longest task, at least 5)")
    parser.add_argument("--partition", default="", metavar="NAME", help="part of the cluster (partition) to use (default: Slurm's default partition)")
    parser.add_argument("--sbatch", default="", metavar="OPTIONS", help="further options for sbatch, Slurm's command that submits tasks, such as --sbatch='--account=x --qos=y'")
    parser.add_argument("--patience", type=number(float, 1, 1e6), default=600, metavar="S",
                        help="how long to wait if the cluster does not answer or takes no tasks, seconds (default: 600)")
    parser.add_argument("--retry", action="store_true", help="try scans again that failed in an earlier run (known failures)")
    parser.add_argument("--strict", action="store_true", help="end with exit code 3 also if only known failures are left")
    parser.add_argument("--max-failures", type=number(int, 1, 10**9), default=0, metavar="N", help="end the run after N new failures (default: no limit)")
    parser.add_argument("--metrics", metavar="FILE", help="write the counts and the duration of the run to this file, in the text format of the monitoring program Prometheus")
    parser.add_argument("--plan", metavar="COLLECTION.json", help="only estimate time and bytes for this collection on the nodes of --nodes or --local-cluster. The estimate comes from a sample of the scans or, with -o, from the times of earlier runs, which the store keeps (its journal)")
    parser.add_argument("--nodes", type=number(int, 1, 100000), metavar="N", help="for --plan: number of nodes")
    parser.add_argument("--slots", type=number(int, 1, 1024), default=1, metavar="N", help="for --plan: number of tasks at the same time on a node (default: 1)")
    parser.add_argument("--scans", type=numbers(lambda text: int(float(text)), 1, 10**9), default=[], metavar="M[,M]",
                        help="for --plan: estimate for M scans like those of the collection (default: as many as the collection has)")
    parser.add_argument("--json", action="store_true", help="print the summary, or the plan, as JSON")
    parser.add_argument("--version", action="version", version=f"{os.path.basename(NAME)} {VERSION}", help="print the version and exit")
    given = parser.parse_args(words)
    if given.plan:
        if given.collection or bool(given.nodes) == bool(given.local):
            raise FarmError(USAGE, "--plan COLLECTION.json wants --nodes N or --local-cluster N, and no other collection")
    elif bool(given.collection) != bool(given.store):
        raise FarmError(USAGE, f"a run wants COLLECTION.json and -o STORE; {'-o STORE' if given.collection else 'COLLECTION.json'} is missing")
    elif not given.collection and not given.local:
        raise FarmError(USAGE, f"give COLLECTION.json and -o STORE, --local-cluster N or --plan; {NAME} --help")
    for name in ("nodes", "scans") if not given.plan else ():
        if getattr(given, name):
            raise FarmError(USAGE, f"--{name} is only for --plan")
    if given.metrics and not pathlib.Path(given.metrics).absolute().parent.is_dir():
        raise FarmError(WRITE, f"{given.metrics}: there is no folder {pathlib.Path(given.metrics).absolute().parent}")
    return given


def farm(given):
    own = LocalCluster(given.local) if given.local else None
    tool = program.Program(program.find(given.program, ROOT), os.path.abspath(given.collection), os.path.abspath(given.store))
    options = watch.Options(given.partition, given.throttle, given.jobs, OWN_POLL_S if own else POLL_S, given.patience,
                            [*([f"--partition={given.partition}"] if given.partition else []), *shlex.split(given.sbatch)],
                            ["--retry"] if given.retry else [], given.max_failures)
    slurm.answer_s = min(slurm.answer_s, max(given.patience, 5))
    work = run.Run(tool, options, own, given.chunk, given.limit, say)
    try:
        numbers = work.all()
    except (KeyboardInterrupt, FarmError) as stopped:
        write_metrics_at_stop(given, work, tool.store, stopped)
        raise
    print(json.dumps(numbers, indent=1) if given.json else summary.text(numbers))
    if given.metrics:
        metrics.write(pathlib.Path(given.metrics), numbers, tool.store)
    names = [row["scan"] for row in numbers["known_failures"]]
    if names and len(names) == numbers["scans"] and not any((pathlib.Path(tool.store) / "assets" / f"{name}.glb").exists() for name in names):
        raise FarmError(REFUSED, "none of the scans could be made, now or in earlier runs; trocar-mesh batch --dry-run lists the reasons")
    return REFUSED if numbers["failed"] or numbers["not_finished"] or (given.strict and numbers["known_failures"]) else DONE


def write_metrics_at_stop(given, work, store, stopped):
    """So that an alert about scans that are left is given. `stopped`: what ended the run; the caller says it."""
    try:
        if given.metrics and (numbers := work.numbers_at_stop()):
            metrics.write(pathlib.Path(given.metrics), numbers, store)
    except FarmError as error:
        if str(error) != str(stopped):
            say(error)


def only_cluster(given):
    with LocalCluster(given.local) as cluster:
        print(f"export SLURM_CONF={cluster.folder / 'slurm.conf'}", flush=True)
        say(f"{given.local} nodes are idle; Ctrl-C takes the cluster down")
        threading.Event().wait()
    return DONE


def interrupted(*_):
    for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(sign, signal.SIG_IGN)  # what is under way is taken down, undisturbed
    raise KeyboardInterrupt


def main(words):
    for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(sign, interrupted)
    given = None
    try:
        given = arguments(words)
        if given.plan:
            return plan.main(given, ROOT, say)
        return farm(given) if given.collection else only_cluster(given)
    except FarmError as error:
        say(error)
        return error.code
    except KeyboardInterrupt:
        if given and not given.plan and not given.collection:
            return DONE
        say("interrupted; the same command again finishes what is missing")
        return WRITE
    except BrokenPipeError:
        return WRITE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
