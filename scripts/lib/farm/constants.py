# SPDX-License-Identifier: Apache-2.0
"""Measures the constants of a plan: on a sample of the collection's scans or from a store's journal, and on this machine's file system,
program and Slurm. Each constant names its source."""
import concurrent.futures
import dataclasses
import json
import os
import pathlib
import shutil
import subprocess
import time

import journal
import slurm
from cluster import PROGRAMS, LocalCluster
from errors import BUG, GET_SLURM, REFUSED, USAGE, FarmError

SAMPLE = 8  # scans in a batch of the sample
SAMPLE_BATCHES, SAMPLE_S = 5, 10  # at most this number of batches, until they have taken this time
ATOMIC_FILES = 40  # of each writer
WRITERS = (1, 4, 16)
READERS = (1, 4)
READ_MAX_S = 5  # for each number of readers
COPIES = 200  # copies of a scan, to time the check of each
ENTRIES = 20000  # entries of a collection, to time its reading
TASKS, NODES = 24, 2
# Report, asset, action and index entry of a scan, each an atomic file.
FILES_PER_SCAN = 4
READS_PER_SCAN = 2  # for the digest and for meshing; the second read is often from memory


@dataclasses.dataclass(frozen=True)
class Constant:
    what: str
    value: float
    unit: str
    source: str


class Measurement:
    """`say` is called with the next step. Files are made in `scratch`, a folder on the store's file system. `nodes`: of the cluster on which
    Slurm is measured."""

    def __init__(self, program, collection, store, scratch, nodes, say):
        self.program, self.collection, self.store, self.scratch, self.say = program, pathlib.Path(collection), store, scratch, say
        self.nodes = nodes
        self.out = {}
        self.scans = self.read_collection()

    def read_collection(self):
        try:
            self.document = json.loads(self.collection.read_text())
            scans = self.document["scans"]
            if not scans or not all(isinstance(scan.get("name"), str) for scan in scans):
                raise ValueError("no scans")
            return scans
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise FarmError(USAGE, f"{self.collection}: no collection ({error})") from None

    def keep(self, name, what, value, unit, source):
        self.out[name] = Constant(what, value, unit, source)

    def batch(self, collection, store, *options):
        """Runs a batch and returns its seconds and its output."""
        start = time.monotonic()
        done = subprocess.run([self.program, "batch", collection, "-o", store, "--jobs", "1", "--quiet", *options], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, check=False)
        if done.returncode not in (0, REFUSED):
            lines = done.stderr.strip().splitlines()
            raise FarmError(done.returncode if done.returncode in (USAGE, 4) else BUG, lines[-1] if lines else "the program failed")
        return time.monotonic() - start, done.stdout

    def only(self, names):
        file = self.scratch / "only"
        file.write_text("\n".join(names) + "\n")
        return "--only", file

    # --- scans ---

    def of_scans(self):
        names = {scan["name"] for scan in self.scans}
        entries = [entry for entry in journal.Journal(self.store).new_entries() if entry.scan in names] if self.store else []
        if entries:
            store, source = pathlib.Path(self.store), f"journal of {self.store}"
        else:
            store, spent, count = self.scratch / "sample", 0, 0
            for some in self.samples():
                self.say(f"meshing {len(some)} scans of the collection")
                spent += self.batch(self.collection, store, *self.only(some))[0]
                count += len(some)
                if spent > SAMPLE_S:
                    break
            source = f"{count} scans, made now with one thread"
            entries = journal.Journal(store).new_entries()
        last = journal.full_work(entries)
        made = {name: entry for name, entry in last.items() if entry.outcome == "made"}
        if not made:
            raise FarmError(REFUSED, f"{self.collection}: none of its scans could be made, nothing can be measured")
        self.sample = sorted(made)
        count = len(made)
        source += f": {count} made" + (f", {len(last) - count} failed" if len(last) > count else "")
        self.keep("scan_s", "time of a scan", sum(entry.seconds for entry in last.values()) / len(last), "s", source)
        self.keep("input_bytes", "input of a scan", sum(entry.input_bytes for entry in made.values()) / count, "bytes", source)
        self.keep("asset_bytes", "asset", sum(entry.bytes for entry in made.values()) / count, "bytes", source)
        self.keep("made_share", "scans that can be made", count / len(last), "", source)
        slices = triangles = 0
        for name in made:
            try:
                report = json.loads((store / "reports" / f"{name}.json").read_text())
                slices += len({one["index"] for one in report["slices"]})
                triangles += report["asset"]["triangles"]
            except (OSError, ValueError, KeyError, TypeError):
                continue
        if slices and triangles:
            self.keep("slice_s", "time of a slice", sum(entry.seconds for entry in made.values()) / slices, "s", source)
            self.keep("triangle_bytes", "asset, of a triangle", sum(entry.bytes for entry in made.values()) / triangles, "bytes", source)
        products = [file.stat().st_size for name in made for file in (store / "products" / name).rglob("*") if file.is_file()]
        self.keep("product_bytes", "products of a scan", sum(products) / count, "bytes", source)
        self.keep("product_files", "files of them", len(products) / count, "", source)
        beside = sum(file.stat().st_size for folder in ("actions", "scans", "reports") for file in (store / folder).rglob("*") if file.is_file())
        kept = sum(1 for _ in (store / "scans").glob("*.json")) or 1
        self.keep("beside_bytes", "report, action and index entry", beside / kept, "bytes", f"files of {store}" if store == self.store else source)

    def samples(self):
        """Names of different scans in batches, each batch from all parts of the collection."""
        names = [scan["name"] for scan in self.scans]
        step = max(1, len(names) // SAMPLE)
        batches = min(SAMPLE_BATCHES, step)
        for k in range(batches):
            yield names[k * step // batches::step][:SAMPLE]

    # --- the file system ---

    def of_files(self):
        """The file system's rates. More writers than one share its syncs, so that the rate of one says nothing about that of many."""
        self.say("reading and writing files")
        files = [file for file in self.inputs() if file.stat().st_size > 0][:200]
        for readers in READERS if files else ():
            read, spent = in_parallel(readers, lambda k, n=readers: read_files(files[k::n]))
            self.keep(f"read_bytes_per_s.{readers}", f"reading inputs, {count_of(readers, 'reader')}", read / spent, "bytes/s",
                      f"{read / 1e6:.1f} MB of them, not from memory, by threads of this machine")
        for writers in WRITERS:
            written, spent = in_parallel(writers, lambda k, n=writers: write_files(self.scratch / f"atomic{n}.{k}"))
            self.keep(f"files_per_s.{writers}", f"atomic files (create, sync, rename, sync), {count_of(writers, 'writer')}", written / spent, "files/s",
                      f"{written} files of 20 kB in {self.scratch.parent}, by threads of this machine")

    def inputs(self):
        """The files that the collection names, or that lie in folders that it names."""
        for scan in self.scans:
            given = scan.get("input")
            if isinstance(given, dict):
                given = given.get("folder") or os.path.dirname(str(given.get("glob", "")))
            for path in given if isinstance(given, list) else [given]:
                found = self.collection.parent / str(path)
                if found.is_file():
                    yield found
                elif found.is_dir():
                    yield from (file for file in sorted(found.iterdir()) if file.is_file())

    # --- costs of each scan of a collection, whatever its outcome ---

    def of_collection(self):
        self.say("reading collections")
        scan = dict(next(one for one in self.scans if one["name"] == self.sample[0]))
        scan["input"] = self.absolute(scan["input"])
        parameters = {**self.document.get("defaults", {}), **scan.get("parameters", {})}
        scan["parameters"] = {name: str((self.collection.parent / value).resolve()) if name in ("hu", "mask", "names", "input-key") else value
                              for name, value in parameters.items()}
        store, seconds = self.scratch / "copies", {}
        for count in (COPIES, ENTRIES):
            file = self.scratch / f"copies{count}.json"
            file.write_text(json.dumps({"schema": self.document.get("schema"), "scans": [{**scan, "name": f"copy{k}"} for k in range(count)]}))
            self.batch(file, store, *(self.only(["copy0"]) if count == ENTRIES else ()))
            seconds[count] = min(self.batch(file, store, *self.only(["copy0"]))[0] for _ in range(3))
        copies = self.scratch / f"copies{COPIES}.json"
        all_of_them, one = (min(self.batch(copies, store, "--dry-run", "--json", *options)[0] for _ in range(3)) for options in ((), self.only(["copy0"])))
        entry = max(0.0, (seconds[ENTRIES] - seconds[COPIES]) / (ENTRIES - COPIES))
        self.keep("start_s", "start of the program in a task", max(0.0, seconds[COPIES] - COPIES * entry), "s", "a run with nothing to do, now")
        self.keep("entry_s", "reading an entry of the collection", entry, "s", f"collections of {COPIES} and {ENTRIES} entries, now")
        self.keep("look_s", "finding that a scan is up to date", max(0.0, (all_of_them - one) / (COPIES - 1)), "s",
                  f"--dry-run on {COPIES} such scans, and on one, now")

    def absolute(self, given):
        if isinstance(given, list):
            return [self.absolute(one) for one in given]
        if isinstance(given, dict):
            return {key: self.absolute(value) if key in ("folder", "glob") else value for key, value in given.items()}
        return os.path.abspath(self.collection.parent / str(given))

    # --- Slurm ---

    def of_slurm(self):
        """On a separate cluster: the time a slot takes for an empty task, and slurmctld's processor time for a task."""
        path = os.environ.get("PATH", "") + ":/usr/sbin:/sbin"
        if any(shutil.which(name, path=path) is None for name in PROGRAMS):
            source = f"assumed; Slurm is not installed here ({GET_SLURM})"
            self.keep("cluster_s", "start of a local cluster", 3.0, "s", source)
            self.keep("dispatch_s", "dispatch of a task", 1.0, "s", source)
            self.keep("controller_s", "slurmctld, of a task", 0.01, "s", source)
            return
        self.say("dispatching empty tasks on a separate cluster")
        start = time.monotonic()
        with LocalCluster(self.nodes) as cluster:
            self.keep("cluster_s", "start of a local cluster", time.monotonic() - start, "s", f"{self.nodes} nodes here, now")
            controller = int((cluster.folder / "run" / "slurmctld.pid").read_text())
            before, start = processor_s(controller), time.monotonic()
            slurm.submit("#!/bin/sh\nexit 0\n", "--job-name=trocar-plan", f"--array=0-{TASKS - 1}", "--output=/dev/null")
            while any(task.state in slurm.ACTIVE for task in slurm.tasks("trocar-plan")):
                time.sleep(0.2)
                if time.monotonic() - start > 120:
                    raise FarmError(BUG, "empty tasks did not end within 120 s")
            spent, used = time.monotonic() - start, processor_s(controller) - before
        source = f"{TASKS} empty tasks on a cluster of {self.nodes} nodes here, now"
        self.keep("dispatch_s", "dispatch of a task", spent * self.nodes / TASKS, "s", source)
        self.keep("controller_s", "slurmctld, of a task", max(used / TASKS, 1e-4), "s", source)


def count_of(count, what):
    return f"{count} {what}{'' if count == 1 else 's'}"


def in_parallel(count, work):
    """Calls work(k) for k from 0 to count - 1 in a thread each. Returns the sum of the results, and the seconds that all took."""
    start = time.monotonic()
    with concurrent.futures.ThreadPoolExecutor(count) as pool:
        return sum(pool.map(work, range(count))), time.monotonic() - start


def read_files(files):
    """Reads files that are not in memory, and returns the number of bytes."""
    size, start = 0, time.monotonic()
    for file in files:
        with open(file, "rb", buffering=0) as stream:
            os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
            while block := stream.read(1 << 20):
                size += len(block)
        if time.monotonic() - start > READ_MAX_S:
            break
    return size


def write_files(folder):
    """Writes files as the store does, each complete or not at all, and returns their number."""
    folder.mkdir()
    handle = os.open(folder, os.O_RDONLY)
    for k in range(ATOMIC_FILES):
        with open(folder / "new", "wb") as stream:
            stream.write(b"x" * 20000)
            stream.flush()
            os.fsync(stream.fileno())
        os.rename(folder / "new", folder / str(k))
        os.fsync(handle)
    os.close(handle)
    return ATOMIC_FILES


def processor_s(pid):
    words = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def measure(program, collection, store, scratch, nodes, say):
    """Returns the number of scans of the collection, and the constants by name. `nodes`: of a local cluster that is planned; None: of another."""
    one = Measurement(program, collection, store, scratch, nodes or NODES, say)
    for step in (one.of_scans, one.of_files, one.of_collection, one.of_slurm):
        step()
    return len(one.scans), one.out
