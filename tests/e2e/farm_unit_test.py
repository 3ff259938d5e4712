# SPDX-License-Identifier: Apache-2.0
"""The parts of scripts/farm on a simulated cluster: limits, time limits, lost tasks, held tasks,
throttle, and the arithmetic of chunks and plans."""
import json
import os
import subprocess
import sys

import pytest
from programs import SOURCE

sys.path.insert(0, str(SOURCE / "scripts" / "lib" / "farm"))

import chunk_script  # noqa: E402
import chunks  # noqa: E402
import constants  # noqa: E402
import journal  # noqa: E402
import main  # noqa: E402
import metrics  # noqa: E402
import plan  # noqa: E402
import program  # noqa: E402
import repair  # noqa: E402
import run as farm_run  # noqa: E402
import slurm  # noqa: E402
import summary  # noqa: E402
import watch  # noqa: E402
from errors import VERSION, FarmError  # noqa: E402
from run_folder import RunFolder  # noqa: E402


@pytest.fixture(name="folder")
def new_run_folder(tmp_path):
    with RunFolder(tmp_path / "store") as folder:
        yield folder


class Cluster:
    """Stands for slurm.py. Its tasks end when finish() is told so, by writing their result as the script would."""

    def __init__(self, folder, array=1001, jobs=10000):
        self.folder, self.known_limits = folder, {"MaxArraySize": array, "MaxJobCount": jobs}
        self.table, self.said, self.scripts = {}, [], []
        self.node_list = [slurm.Node("n1", "idle", "none")]
        self.refuses = self.forgets = False
        for name in ("limits", "tasks", "nodes", "submit", "ask"):
            setattr(slurm, name, getattr(self, name))

    def limits(self):
        return self.known_limits

    def tasks(self, prefix):
        return [task for task in self.table.values() if task.name.startswith(prefix)]

    def nodes(self, _partition):
        return self.node_list

    def ask(self, *command, **_):
        self.said.append(" ".join(map(str, command)))
        if command[0] == "scancel":
            self.set(command[1], "CANCELLED")
        return ""

    def submit(self, script, *options):
        if self.refuses:
            raise slurm.NoAnswer("Invalid partition name specified")
        given = dict(option.lstrip("-").split("=", 1) for option in options if "=" in option)
        assert "--requeue" in options, "a task is not requeued after a node's failure"
        job = str(1 + len(self.scripts))
        self.scripts.append((script, given))
        indices, _, self.throttle = given["array"].partition("%")
        for part in indices.split(","):
            first, _, last = part.partition("-")
            for index in range(int(first), int(last or first) + 1):
                assert index < self.known_limits["MaxArraySize"], f"index {index} is not below MaxArraySize"
                if not self.forgets:
                    self.table[f"{job}_{index}"] = slurm.Task(job, index, "PENDING", "Resources", given["job-name"])
        assert len(self.active()) <= self.known_limits["MaxJobCount"] // 2, "more tasks than half of MaxJobCount"
        return job

    def active(self):
        return [key for key, task in self.table.items() if task.state in slurm.ACTIVE]

    def set(self, key, state, reason="None"):
        task = self.table[key]
        self.table[key] = slurm.Task(task.job, task.index, state, reason, task.name)

    def finish(self, key, code=0, state="COMPLETED"):
        task = self.table[key]
        if code is not None:
            number, offset = task.name.split("-")[-2:]
            (self.folder.path / f"result.{number}.{int(offset) + task.index}").write_text(f"{code}\n")
        self.set(key, state)


class Program:
    def command(self, *options):
        return ["trocar-mesh", "batch", "a collection.json", "-o", "store", *options]


def a_round(folder, count, own=True, throttle=0, **cluster):
    said = []
    told = Cluster(folder, **cluster)
    options = watch.Options("", throttle, 1, 0, 600, [], [])
    one = watch.Round(Program(), folder, options, repair.Repair(own, "", said.append), said.append, 0, [[f"s{k}"] for k in range(count)], 5)
    return told, one, said


def finish_all(told, one, most=100):
    for _ in range(most):
        if all(chunk.end for chunk in one.chunks.values()):
            return
        for key in told.active():
            told.finish(key)
        one.poll()
    pytest.fail(f"not finished after {most} polls: {[(k, c.end) for k, c in one.chunks.items() if not c.end][:5]}")


def test_limits(folder):
    told, one, _ = a_round(folder, 250, array=40, jobs=120)
    one.poll()
    assert len(told.active()) == 60, f"limits: {len(told.active())} tasks at first"
    finish_all(told, one)
    held = [int(given["job-name"].rpartition("-")[2]) for _, given in told.scripts]
    assert len(told.scripts) >= 7 and held == sorted(held), f"limits: arrays {held}"
    assert "'a collection.json'" in told.scripts[0][0], "limits: the script's words are quoted"


def test_throttled(folder):
    told, one, _ = a_round(folder, 30, throttle=4, array=11)
    one.poll()
    assert told.throttle == "4" and len(told.scripts) == 1, "throttle: one array at a time, with %K"
    finish_all(told, one)


def test_ends(folder):
    told, one, _ = a_round(folder, 5)
    one.poll()
    told.finish("1_0", 3)  # failed scans are recorded
    told.finish("1_1", None, "TIMEOUT")
    told.finish("1_2", None, "FAILED")
    for _ in range(6):
        one.poll()
    assert one.chunks[1].end == watch.DONE and one.chunks[2].end == watch.TIMEOUT and not one.chunks[3].end, f"ends: {one.chunks}"
    assert one.resubmitted == 1 and len(told.scripts) == 2 and told.scripts[1][1]["array"] == "0", f"ends: {[given for _, given in told.scripts]}"
    while not one.chunks[3].end and len(told.scripts) < 20:
        told.finish(told.active()[-1], None, "FAILED")
        one.poll()
        if told.active() == ["1_3", "1_4"]:
            for _ in range(watch.GRACE_POLLS + 1):
                one.poll()
    assert one.chunks[3].attempts == watch.ATTEMPTS and "FAILED" in one.chunks[3].end, f"ends: given up: {one.chunks[3]}"
    told.finish("1_3", 2)
    (folder.path / "log.0.4").write_text("trocar-mesh: a collection.json: wrong\n")
    try:
        one.poll()
        pytest.fail("ends: wrong usage of the program goes on")
    except FarmError as error:
        assert error.code == 2 and str(error) == "a collection.json: wrong", f"ends: {error}"


def test_forgotten(folder):
    told, one, _ = a_round(folder, 3)
    told.forgets = True
    one.poll()
    told.forgets = False
    for _ in range(watch.GRACE_POLLS + 2):
        one.poll()
    assert len(told.active()) == 3 and len(told.scripts) == 2, f"forgotten: a lost submission: {told.scripts}"
    told.finish("2_0", None, "COMPLETED")
    (folder.path / "result.0.1").write_text("0\n")
    told.set("2_1", "RUNNING")
    (folder.path / "result.0.2").write_text("0\n")
    one.poll()
    one.repair.ended = {key: since - repair.ENDED_S - 1 for key, since in one.repair.ended.items()}
    one.poll()
    assert "scancel 2_1" in told.said and "scancel 2_2" not in told.said, f"forgotten: {told.said}"


def test_held(folder):
    for own in (True, False):
        folder.clear()
        told, one, said = a_round(folder, 2, own=own)
        one.poll()
        told.set("1_0", "PENDING", "launch failed requeued held")
        told.node_list = [slurm.Node("n1", "drained", "Duplicate jobid"), slurm.Node("n2", "idle", "none")]
        for _ in range(watch.GRACE_POLLS + 2):
            one.poll()
        resume, release = "scontrol update nodename=n1 state=resume", "scontrol release 1_0"
        if own:
            assert resume in told.said and release in told.said and not said, f"held: own cluster: {told.said} {said}"
        else:
            assert all(word.startswith("scancel 1_0") for word in told.said), f"held: foreign cluster: {told.said}"
            assert sum("n1" in line and resume in line for line in said) == 1, f"held: the node is named once: {said}"
            assert len(told.scripts) == 2, "held: the chunk is submitted again"
        finish_all(told, one)


def test_ended_tasks_of_an_earlier_run(folder):
    """Slurm lists ended tasks for some minutes. Those of an earlier run on the store are not taken for tasks of this one."""
    told, one, _ = a_round(folder, 2)
    told.table["9_7"] = slurm.Task("9", 7, "COMPLETED", "None", f"{folder.prefix}0-0")  # as an earlier version named it
    with RunFolder(folder.store.with_name("store2")) as other:
        other.prefix, earlier = folder.prefix, other.own_prefix
    told.table["9_0"] = slurm.Task("9", 0, "TIMEOUT", "None", f"{folder.prefix}{earlier.split('-')[-2]}-0-0")
    finish_all(told, one)
    assert [chunk.end for chunk in one.chunks.values()] == [watch.DONE] * 2, one.chunks


@pytest.mark.parametrize("code", [0, 2])
def test_results_of_a_killed_run_are_not_those_of_the_next(tmp_path, code):
    """A task of a killed run starts, or ends, after the next run has begun. It had the same round and chunk as a task of the next run."""
    killed = RunFolder(tmp_path / "store")
    killed.__enter__()
    killed.write_chunks(0, [["s0"], ["s1"]])
    script = chunk_script.text(["sh", "-c", f"exit {code}"], killed.path, 0, 1, 1)
    killed.lock.close()
    with RunFolder(tmp_path / "store") as folder:
        assert folder.was_left
        subprocess.run(["sh"], input=script, text=True, check=False, stderr=subprocess.DEVNULL,
                       env=os.environ | {"SLURM_ARRAY_TASK_ID": "0", "SLURM_JOB_ID": "7"})
        told, one, _ = a_round(folder, 2)
        one.poll()
        assert not one.chunks[1].end, "a result of the killed run counts"
        finish_all(told, one)
    assert not (tmp_path / "store.farm").exists()


class Stale(Program):
    """A program whose scans stay stale."""
    store = "store"

    def state(self, *_, **__):
        return program.State(4, {f"s{k}": "" for k in range(4)}, {}, 0)


def test_tasks_that_do_nothing(folder, monkeypatch):
    """If no task of the first round writes to the journal, the run ends and says why. It does not submit tasks for ever."""
    said = []
    told = Cluster(folder)
    monkeypatch.setattr(farm_run.time, "sleep", lambda _: [told.finish(key, None, "FAILED") for key in told.active()])
    monkeypatch.setattr(watch, "GRACE_POLLS", 0)
    one = farm_run.Run(Stale(), watch.Options("", 0, 1, 0, 600, [], []), None, 60, 0, said.append)
    one.slots = 1
    for chunk in range(1, 5):
        (folder.path / f"log.0.{chunk}").write_text("trocar-mesh: /all.json: Not a directory\n")
    progress = farm_run.Progress(journal.Journal(folder.store), 4, said.append)
    with pytest.raises(FarmError, match="no task of the first round has done anything: .*/all.json: Not a directory"):
        one.make([f"s{k}" for k in range(4)], folder, progress, [])
    assert len(one.rounds) == 1, one.rounds

    # Tasks that were killed have said nothing. They are tried again in smaller chunks, and at last given up.
    folder.clear()
    killed = farm_run.Run(Stale(), watch.Options("", 0, 1, 0, 600, [], []), None, 60, 0, said.append)
    killed.slots = 1
    killed.make([f"s{k}" for k in range(4)], folder, progress, [])
    assert len(killed.rounds) == 1 + farm_run.TRIES and len(killed.unfinished) == 4, (killed.rounds, killed.unfinished)


def test_where_no_store_can_be(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FarmError, match="file: is no folder"):
        RunFolder(tmp_path / "file").__enter__()
    assert not (tmp_path / "file.farm").exists()


def test_refused(folder):
    told, one, _ = a_round(folder, 2)
    told.refuses = True
    try:
        for _ in range(watch.SUBMIT_FAILURES):
            one.poll()
        pytest.fail("refused: an array that sbatch refuses is submitted for ever")
    except FarmError as error:
        assert error.code == 2 and "Invalid partition" in str(error), f"refused: {error}"


def test_arithmetic(folder):
    for slots, chunk_s, costs in ((3, 60, [1.0] * 600), (3, 60, [1.0] * 10), (4, 60, [200.0, 1, 1, 1, 200]), (2, 5, [0.0] * 7), (1, 60, [70.0])):
        seconds = {f"s{k}": cost for k, cost in enumerate(costs)}
        cut = chunks.cut(seconds, slots, chunk_s)
        assert [name for names in cut for name in names] == list(seconds), f"cut: names {costs[:5]}"
        sums, largest = [sum(seconds[name] for name in names) for names in cut], max(costs)
        assert max(sums) <= min(chunk_s, sum(costs) / slots) + largest + 1e-9, f"cut: {sums}"
    assert len(chunks.cut({f"s{k}": 1.0 for k in range(600)}, 3, 60)) == 10, "cut: ten chunks of a minute"
    assert chunks.index_text([0, 1, 2, 5, 7, 8]) == "0-2,5,7-8", "index_text"
    assert farm_run.limit_minutes(60) == 10 and farm_run.limit_minutes(1) == 5, "limit_minutes"
    store = folder.path
    (store / "journal").mkdir()
    lines = ['{"scan": "a", "outcome": "made", "seconds": 2}', '{"scan": "b", "outcome": "failed", "seconds": 1, "exit_code": 137}',
             '{"scan": "c", "outcome": "failed", "seconds": 1, "exit_code": 3}', '{"scan": "a", "outcome": "found", "seconds": 0.01}', "[1]", '"x"',
             '{"scan": 1, "outcome": "made", "seconds": 2}', '{"scan": "d", "outcome": "made", "seconds": NaN}', '{"scan": "e", "outc']
    (store / "journal" / "x.ndjson").write_bytes("\n".join(lines).encode() + b"\n\xff\xfe{}\n{\"scan\"")
    entries = journal.Journal(store).new_entries()
    assert [entry.scan for entry in entries] == ["a", "b", "c", "a"], f"journal: {entries}"
    assert journal.estimates(entries, ["a", "z"], 9) == {"a": 2.0, "z": 4 / 3} and journal.estimates([], ["z"], 9) == {"z": 9}, "estimates"


# One writer of this file system waits for its own syncs; sixteen share them.
CONSTANTS = {"scan_s": 1.0, "input_bytes": 1e6, "asset_bytes": 1e4, "beside_bytes": 1e3, "product_bytes": 2e5, "product_files": 3, "made_share": 0.9, "read_bytes_per_s.1": 1e8, "read_bytes_per_s.4": 1e8,
             "files_per_s.1": 527, "files_per_s.4": 869, "files_per_s.16": 3700, "start_s": 0.1, "entry_s": 1e-6, "look_s": 1e-5, "dispatch_s": 1.0,
             "controller_s": 0.01, "cluster_s": 3.0}


def test_plan():
    small = plan.work_out(6000, 10, 1, 60, CONSTANTS)
    assert small["chunks"] == 100 and abs(small["task_s"] - 61.106) < 1e-9, small
    assert abs(small["seconds"] - (10 * 61.106 + 3 * (0.1 + 6000 * 1.1e-5))) < 1e-6, small["seconds"]
    assert small["product_bytes"] == 5400 * 2e5 and small["files"] == 5400 * 12 + 600, small
    assert small["asset_bytes"] == 5400 * 1e4 and small["read_bytes"] == 2 * 6000 * 1e6, small
    assert small["limits"][0]["what"] == "reading inputs" and small["limits"][0]["slots"] == 50, small["limits"]
    large = plan.work_out(6000, 1000, 1, 60, CONSTANTS)
    assert large["useful_slots"] < 1000 and large["seconds"] > 6000 * 2 * 1e6 / 1e8, f"beyond what saturates: {large}"


def test_times_from_a_journal_are_those_of_the_scans_of_the_collection(tmp_path):
    store, collection = tmp_path / "store", tmp_path / "scans.json"
    (store / "journal").mkdir(parents=True)
    lines = [json.dumps({"scan": name, "outcome": "made", "seconds": seconds}) for name, seconds in (("a", 9), ("b", 1))]
    (store / "journal" / "one.ndjson").write_text("\n".join(lines) + "\n")
    collection.write_text('{"scans": [{"name": "b", "input": "b.nii"}]}')
    measurement = constants.Measurement("none", collection, store, tmp_path, 1, print)
    measurement.of_scans()
    assert measurement.sample == ["b"] and measurement.out["scan_s"].value == 1, measurement.out


def test_plan_with_writers_that_share_syncs():
    # 95 files a second from each slot: one writer's 527 a second would be used up by 5 slots, but 16 writers' 3,700 serve 38.
    fast = {**CONSTANTS, "scan_s": 0.04, "input_bytes": 0, "dispatch_s": 0.1, "start_s": 0.01, "controller_s": 1e-4}
    twenty = plan.work_out(10 ** 5, 20, 1, 60, fast)
    assert twenty["useful_slots"] == 20, twenty["limits"]
    five = plan.work_out(10 ** 5, 5, 1, 60, fast)
    assert five["seconds"] > 3 * twenty["seconds"], (five["seconds"], twenty["seconds"])
    hundred = plan.work_out(10 ** 5, 100, 1, 60, fast)
    assert 30 <= hundred["useful_slots"] <= 40, hundred["limits"]


def test_plan_of_a_local_cluster():
    of = {**CONSTANTS, "input_bytes": 0}
    for slots, useful in ((1, 1), (3, 2), (6, 2)):
        one = plan.work_out(320, slots, 1, 60, of, processors=2)
        assert one["useful_slots"] == useful, one["limits"]
        assert abs(one["seconds"] - 3 - one["looks_s"] - 320 / useful) < 12, one


def test_rates():
    measured = {1: 100.0, 4: 400.0, 16: 1000.0}
    assert [plan.rate_of(measured, users) for users in (1, 2, 4, 10, 16, 99)] == [100, 200, 400, 700, 1000, 1000]
    assert [plan.limit_of(measured, each) for each in (1.0, 70.0, 101.0)] == [1000, 10, 1], "limit_of"


def state(scans, stale, known=()):
    return program.State(scans, dict(stale), dict(known), 1000)


def entry(scan, outcome="made"):
    return journal.Entry(scan, outcome, 2.0, 10, 100, 5_000_000, "")


def summary_of(before, after, unfinished, entries):
    return summary.Summary(before, after, unfinished, entries, 8.0, 2, [], 0, 0).numbers()


def test_each_scan_is_in_one_class():
    names = [f"s{k}" for k in range(320)]
    before = state(330, {name: "" for name in names}, {"old": "damaged"})
    # Nine failed for reasons in the scans; one was killed by a signal each time, and one by the time limit. The journal has lost ten lines.
    after = state(330, {"s9": "its process was killed by signal 9 (SIGKILL)", "s10": ""}, {"old": "damaged", **{f"s{k}": "no bone" for k in range(9)}})
    numbers = summary_of(before, after, {"s10": "time limit"}, [entry(name) for name in names[20:]])
    assert (numbers["unchanged"], numbers["done"], len(numbers["failed"]), len(numbers["known_failures"]), len(numbers["not_finished"])) == (9, 309, 10, 1, 1)
    assert "memory of a scan: at most 5 MB" in summary.text(numbers)
    assert numbers["failed"][-1] == {"scan": "s9", "reason": "its process was killed by signal 9 (SIGKILL)"}
    assert numbers["not_finished"] == [{"scan": "s10", "reason": "time limit"}]
    assert summary.text(numbers).splitlines()[0] == "330 scans: 9 unchanged, 309 made, 10 failed, 1 known failure (trocar-mesh batch --dry-run lists them), 1 not finished"
    again = summary_of(state(330, {"s10": ""}, after.known), state(330, {}, after.known), {}, [])
    assert (again["unchanged"], again["done"], len(again["failed"]), len(again["known_failures"])) == (319, 1, 0, 10)


def test_metrics(tmp_path):
    numbers = summary_of(state(3, {"a": "", "b": ""}), state(3, {}, {"b": "no"}), {}, [entry("a")])
    metrics.write(tmp_path / "farm.prom", numbers, '/a "b"')
    lines = (tmp_path / "farm.prom").read_text().splitlines()
    assert 'trocar_batch_scans{store="/a \\"b\\"",class="failed"} 1' in lines and 'trocar_batch_asset_bytes{store="/a \\"b\\""} 1000' in lines
    assert [file.name for file in tmp_path.iterdir()] == ["farm.prom"]
    with pytest.raises(FarmError, match="no such file|No such file"):
        metrics.write(tmp_path / "none" / "x", numbers, "")


@pytest.mark.parametrize("end", [KeyboardInterrupt(), FarmError(4, "slurmctld does not answer")])
def test_metrics_of_a_run_that_was_stopped(tmp_path, monkeypatch, end):
    store, file = tmp_path / "store", tmp_path / "farm.prom"
    states = [state(4, dict.fromkeys("abc", ""), {"old": "damaged"}), state(4, {"b": "", "c": "killed"}, {"old": "damaged"})]

    class Stopped(Program):
        def __init__(self, *_):
            self.store = str(store)

        def state(self, *_, **__):
            return states.pop(0)

    def stop(*_):
        raise end

    monkeypatch.setattr(main.signal, "signal", lambda *_: None)
    monkeypatch.setattr(program, "Program", Stopped)
    monkeypatch.setattr(program, "find", lambda *_: "trocar-mesh")
    monkeypatch.setattr(slurm, "require", lambda: None)
    monkeypatch.setattr(farm_run.Run, "on_cluster", stop)
    assert main.main([str(tmp_path / "scans.json"), "-o", str(store), "--metrics", str(file)]) == 4
    counts = {line.split('class="')[1].split('"')[0]: int(line.split()[-1]) for line in file.read_text().splitlines() if 'class="' in line}
    assert counts == {"unchanged": 0, "made": 1, "failed": 0, "known_failure": 1, "left": 2}, counts
    assert not states


def test_max_failures(folder):
    told, one, _ = a_round(folder, 10)
    seen = []
    one.run_all(lambda: seen.append(told.finish(told.active()[0], 3)), lambda: len(seen) == 2)
    assert len(seen) == 2 and len(told.active()) == 8, "a round does not end when it has enough failures"


def test_version_is_the_projects():
    assert f"project(trocar VERSION {VERSION} " in (SOURCE / "CMakeLists.txt").read_text()


def test_an_interrupted_run_says_how_far_it_came():
    class Log:
        def new_entries(self):
            return [entry("a", "failed"), entry("a"), entry("b"), entry("c", "failed")]
    assert farm_run.Progress(Log(), 5, print).until_now() == "2 of 5 scans were made, 1 failed"


def made(scan, seconds, outcome="made"):
    return journal.Entry(scan, outcome, seconds, 10, 100, 5_000_000, "")


def test_estimates_come_from_the_longest_work_on_a_scan():
    entries = [made("a", 3), made("a", 0.2), made("a", 0.1, "failed"), made("a", 9, "found"), made("b", 5, "failed"), made("b", 1, "failed"),
               made("c", 0.1, "failed"), made("c", 2)]
    work = journal.full_work(entries)
    assert {name: (entry.seconds, entry.outcome) for name, entry in work.items()} == {"a": (3, "made"), "b": (1, "failed"), "c": (2, "made")}
    assert journal.estimates(entries, ["a", "new"], 60) == {"a": 3, "new": 2}
    assert journal.estimates([], ["new"], 60) == {"new": 60}


def test_a_run_stopped_by_failures_names_them():
    numbers = summary.Summary(state(3, {"a": "", "b": "", "c": ""}), state(3, {"a": "", "b": "", "c": ""}),
                              {"a": "not tried", "b": "not tried", "c": "not tried"},
                              [journal.Entry("b", "failed", 1, 0, 0, 0, "No space left on device")], 1, 1, [], 0, 0, True).numbers()
    assert numbers["failed"] == [{"scan": "b", "reason": "No space left on device"}] and len(numbers["not_finished"]) == 2


@pytest.mark.parametrize("said, reason", [
    ("sbatch: error: Batch job submission failed: Invalid partition name specified", "Invalid partition name specified"),
    ('sbatch: unrecognized option \'--wrong=1\'\nTry "sbatch --help" for more information\n', "unrecognized option '--wrong=1'"),
    ("sinfo: fatal: Could not establish a configuration source", "Could not establish a configuration source"),
    ("", "")])
def test_the_reason_in_a_message_of_slurm(said, reason):
    assert slurm.error_in(said) == reason


def test_what_slurm_never_takes_ends_the_run_at_once(folder):
    told, one, _ = a_round(folder, 2)
    told.refuses = True
    with pytest.raises(FarmError, match="Invalid partition name specified; sinfo lists the partitions"):
        one.run_all(lambda: pytest.fail("waits"), lambda: False)
    assert slurm.not_there("Could not establish a configuration source").code == 2 and slurm.not_there("no answer").code == 4


def test_options_of_batch_are_named(capsys):
    assert main.main(["scans.json", "-o", "store", "--gc"]) == 2
    assert "--gc: is an option of trocar-mesh batch" in capsys.readouterr().err
