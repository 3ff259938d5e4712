# SPDX-License-Identifier: Apache-2.0
"""trocar-mesh batch, as a farm uses it.

results  a collection of 200 scans, ten of them broken: each asset is that of a run by hand; a second run does nothing; a scan, a
         parameter, the program that changes, and what --explain says of it; shards; the schema; list --manifest
faults   a kill at every step around a temporary file, of the scan's process, the batch, and both (at random moments: farm_test.py)
trouble  a full disk, a store that cannot be written, damaged objects, a scan that changes while it is read, crashed processes
several  two batches and a --gc at once; --gc alone; a lease
hostile  wrong collections, wrong options
many     500 scans: memory, and the time of a second run (counted in files read, not in seconds)
"""
import json
import os
import pathlib
import re
import resource
import shutil
import signal
import stat
import subprocess
import time

from batch_collection import collection_of_200, difference, label_map, make_scans, snapshot, strays, write_collection
from e2e import check
from exported import schema_of
from programs import PROGRAMS, run

# Parts that kill or stop processes at failpoints need the program in which these act; without TROCAR_FAILPOINT it is trocar-mesh.
MESH = PROGRAMS / "trocar-mesh-failpoints"
ROUNDS = 500
SHA256_DIGITS = 64


def batch(collection, store, *options, expect=0, program=MESH, **keys):
    """The summary."""
    done = run(program, "batch", collection, "-o", store, "--json", *options, expect=expect, **keys)
    summary = json.loads(done.stdout) if done.stdout else {}
    if "made" in summary:
        check(sum(counts(summary)) + summary["left"] == summary["scans"], f"a scan is in no class, or in two: {summary}")
    return summary


def counts(summary):
    return tuple(summary[key] for key in ("unchanged", "made", "found", "failed", "known"))


def expect_counts(summary, unchanged, made, found, failed, what, known=0):
    wanted = (unchanged, made, found, failed, known)
    check(counts(summary) == wanted, f"{what}: unchanged, made, found, failed, known {counts(summary)}, not {wanted}")


def expect_equal(store, reference, what):
    differs = difference(snapshot(store), reference)
    check(not differs, f"{what}: the store differs in {differs}")
    check(not strays(store), f"{what}: left {strays(store)[:3]}")


def explain(collection, store, scan, **keys):
    return batch(collection, store, "--explain", scan, **keys)["why"]


def small_collection(folder):
    """Four scans, NIfTI, DICOM, PNG and labels, of 3 slices."""
    folder.mkdir(parents=True)
    make_scans(PROGRAMS, folder, slices=3, size=64)
    file = folder / "collection.json"
    write_collection(file, [
        {"name": "nifti", "input": "phantom/sample.nii.gz"},
        {"name": "dicom", "input": {"folder": "phantom/dicom", "series": 1}, "parameters": {"threshold": 200}},
        {"name": "png", "input": "phantom/png", "parameters": {"spacing": "2.5,2.5,1", "equalize": 230}},
        {"name": "labels", "input": "labels.nii.gz", "parameters": {"labels": "all"}}])
    return file


def change_scan(file, name, change):
    value = json.loads(file.read_text())
    change(next(scan for scan in value["scans"] if scan["name"] == name))
    file.write_text(json.dumps(value))


def test_results(place):
    folder = place / "scans"
    codes = collection_of_200(PROGRAMS, folder)
    collection, store = folder / "collection.json", place / "store"
    schema = schema_of("collection")
    schema.validate(json.loads(collection.read_text()))
    dry = batch(collection, store, "--dry-run")
    check(len(dry["stale"]) == 200 and not store.exists(), "--dry-run names 200 scans and writes nothing")

    done = run(MESH, "batch", collection, "-o", store, "--json", expect=3)
    first = json.loads(done.stdout)
    made = first["made"]
    check(made + first["found"] == 190 and first["failed"] == 10, f"190 done, 10 failed: {counts(first)}")
    check({f["scan"]: f["exit_code"] for f in first["failures"]} == codes, f"failures {first['failures']}")
    for name in codes:
        entry = json.loads((store / "scans" / f"{name}.json").read_text())
        check(entry["status"] == "failed" and entry["exit_code"] == codes[name] and entry["reason"], f"{name}: {entry}")
        check(name in done.stderr and entry["reason"] in done.stderr, f"{name} is not in the table")
        check(not (store / "assets" / f"{name}.glb").exists(), f"{name} has an asset")
    reference = snapshot(store)
    check(not strays(store), f"left {strays(store)}")

    # Modes, digests, private parts.
    for path, text in reference.items():
        mode = stat.S_IMODE((store / path).lstat().st_mode)
        if path.startswith(("actions/", "scans/")):
            check(mode == 0o600, f"{path}: mode {mode:o}")
    for path in (store / "content").rglob("*"):
        if path.is_file():
            digest = run("sha256sum", path).stdout.split()[0]
            check(digest == path.name, f"{path}: its digest is {digest}")
    digests = {f["sha256"] for file in (store / "scans").iterdir() for f in json.loads(file.read_text())["files"] if f["sha256"]}
    check(all(d.encode() not in b[0] for p, b in reference.items() if p.startswith("content/") for d in digests), "an input's digest in content")
    report_schema = schema_of("report")
    for name in ("dicom_1", "labels_1", "png_3", "crop_0"):
        text = (store / "reports" / f"{name}.json").read_text()
        report_schema.validate(json.loads(text))
        check("phantom" not in text and str(place) not in text and "_ms" not in text.replace("_mm", ""), f"{name}: paths or times in the report")

    # The assets are those of runs by hand.
    by_hand = place / "hand.glb"
    for name, options in (("png_3", (*sorted((folder / "phantom/png").iterdir()), "--spacing", "2.5,2.5,1", "--equalize", 203)),
                          ("dicom_1", (folder / "phantom/dicom", "--threshold", 205)),
                          ("labels_1", (folder / "labels.nii.gz", "--labels", "1,2+3", "--slices", "1:2", "--tolerance", 0.12))):
        run(MESH, *options, "--min-angle", 28, "-o", by_hand, "--quiet")
        check(by_hand.read_bytes() == (store / "assets" / f"{name}.glb").read_bytes(), f"{name}: not the asset of a run by hand")

    # A second run, and another store by other processes.
    before = {path: (store / path).lstat().st_mtime_ns for path in reference}
    expect_counts(batch(collection, store), 190, 0, 0, 0, "second run", known=10)
    check(all((store / path).lstat().st_mtime_ns == time_ns for path, time_ns in before.items()), "a second run wrote something")
    expect_equal(store, reference, "second run")
    done = run(MESH, "batch", collection, "-o", store)
    check("10 known failures" in done.stdout and not done.stderr, f"known failures: {done.stdout}")
    done = run(MESH, "batch", collection, "-o", store, "--strict", "--quiet", expect=3)
    check(all(name in done.stderr for name in codes), f"--strict does not name them: {done.stderr}")
    dry = batch(collection, store, "--dry-run")
    check(not dry["stale"] and {one["scan"]: one["exit_code"] for one in dry["known_failures"]} == codes, f"--dry-run: {dry}")
    check(batch(collection, store, "--explain", "bad_text")["status"] == "known_failure", "--explain of a known failure")
    expect_counts(batch(collection, store, "--retry", expect=3), 190, 0, 0, 10, "--retry")
    expect_counts(batch(collection, store, "--rehash"), 190, 0, 0, 0, "--rehash", known=10)
    expect_counts(batch(collection, store, "--verify"), 190, 0, 0, 0, "--verify", known=10)
    for shard in range(3):
        batch(collection, place / "shards", "--shard", f"{shard}/3", "--jobs", shard + 1, expect=3)
    expect_equal(place / "shards", reference, "three shards")
    names = place / "names"
    names.write_text("png_3\ncrop_0\n")
    check(batch(collection, place / "only", "--only", names)["scans"] == 2, "--only")

    # A default that is said, a scan, a parameter, the program.
    change_scan(collection, "crop_0", lambda scan: scan["parameters"].update({"max-area": 50, "contour": "subpixel"}))
    expect_counts(batch(collection, store), 190, 0, 0, 0, "a default that is said", known=10)
    change_scan(collection, "crop_1", lambda scan: scan["parameters"].update({"tolerance": 0.15}))
    check(explain(collection, store, "crop_1") == [{"cause": "parameter", "name": "tolerance", "old": {"default": 0.2}, "new": 0.15}],
          f"--explain of a parameter: {explain(collection, store, 'crop_1')}")
    expect_counts(batch(collection, store), 189, 1, 0, 0, "a parameter", known=10)
    expect_counts(batch(collection, store), 190, 0, 0, 0, "after a parameter", known=10)
    change_scan(collection, "crop_1", lambda scan: scan["parameters"].pop("tolerance"))
    expect_counts(batch(collection, store), 189, 0, 1, 0, "a parameter as it was: found", known=10)

    labels = folder / "labels.nii.gz"
    copy = labels.read_bytes()
    os.utime(labels)
    expect_counts(batch(collection, store), 170, 0, 20, 0, "a file that was touched: read, and found", known=10)
    label_map(labels, folder / "phantom/sample.nii.gz", slice(None))
    value = json.loads(collection.read_text())
    of_labels = [s["name"] for s in value["scans"] if s["input"] == "labels.nii.gz"]
    labels.write_bytes(copy[:-1] + bytes([copy[-1] ^ 1]))
    check(explain(collection, store, of_labels[0]) == [{"cause": "input", "path": "labels.nii.gz", "what": "changed"}],
          f"--explain of an input: {explain(collection, store, of_labels[0])}")
    labels.unlink()
    label_map(labels, folder / "phantom/sample.nii.gz", slice(None))
    changed = labels.read_bytes() != copy
    result = batch(collection, store)
    check(result["unchanged"] == 170 and result["made"] + result["found"] == 20 and (result["made"] > 0) == changed, f"labels: {counts(result)}")

    program = place / "other-trocar-mesh"
    program.write_bytes(MESH.read_bytes() + b"\0")
    program.chmod(0o755)
    why = explain(collection, store, "crop_0", program=program)
    check([w["cause"] for w in why] == ["program"] and len(why[0]["new"]) == SHA256_DIGITS, f"--explain of the program: {why}")
    again = batch(collection, store, expect=3, program=program)  # the failures of another program are not known
    check(again["unchanged"] == 0 and again["made"] > 0 and again["failed"] == 10, f"the program: {counts(again)}")
    expect_counts(batch(collection, store, program=program), 190, 0, 0, 0, "second run of the other program", known=10)
    check([w["cause"] for w in explain(collection, store, "bad_text", program=program)] == ["failed"], "--explain of a failure")
    check(run(MESH, "batch", collection, "-o", store, "--explain", "crop_0", "--quiet").stdout.count("program:") == 1, "--explain as text")

    # Another file in the folder of a series: opened again, and found.
    shutil.copy(folder / "phantom/sample.json", folder / "phantom/dicom/notes.json")
    result = batch(collection, store, program=program)
    expect_counts(result, 170, 0, 20, 0, "another file beside a series", known=10)

    # A first collection.
    (folder / "phantom/noise.nii.gz").write_bytes(b"no NIfTI file" * 100)
    done = run(MESH, "list", "scans/phantom", "--manifest", cwd=place)
    listed = done.stdout
    assert "noise" not in listed and re.search(r"not_in_collection.*noise\.nii\.gz.*cannot be used: ", done.stderr), done.stderr
    schema.validate(json.loads(listed))
    (place / "listed.json").write_text(listed)
    expect_counts(batch(place / "listed.json", place / "listed_store", expect=3), 0, 2, 0, 1, "list --manifest: images need a spacing")


def test_faults(place):
    collection = small_collection(place / "scans")
    value = json.loads(collection.read_text())
    value["scans"] = value["scans"][:1]
    collection.write_text(json.dumps(value))
    # The shipped program has no failpoints.
    batch(collection, place / "shipped", program=PROGRAMS / "trocar-mesh", env=os.environ | {"TROCAR_FAILPOINT": "batch:1"})
    whole = place / "whole"
    batch(collection, whole)
    reference = snapshot(whole)
    key = json.loads((whole / "scans/nifti.json").read_text())["key"]
    total = 0
    for who in ("worker", "batch", "both"):
        for k in range(1, 200):
            store = place / "store"
            shutil.rmtree(store, ignore_errors=True)
            environment = os.environ | {"TROCAR_FAILPOINT": f"{who}:{k}"}
            killed = subprocess.run([MESH, "batch", collection, "-o", store, "--json", "--jobs", "1"], env=environment,
                                    stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False)
            if killed.returncode == 0:
                break
            total += 1
            what = f"kill at step {k} of {who}"
            if who == "worker":
                failure = json.loads(killed.stdout)["failures"][0]
                check(killed.returncode == 3 and failure["signal"] == 9 and "SIGKILL" in failure["reason"], f"{what}: {failure}")
                check(not strays(store), f"{what}: left {strays(store)}")
            else:
                check(killed.returncode == -9, f"{what}: exit code {killed.returncode}")
            was_finished = (store / "actions" / key[:2] / f"{key}.json").exists()
            again = batch(collection, store)
            check(again["made"] == (0 if was_finished else 1), f"{what}: {counts(again)}, was finished: {was_finished}")
            expect_equal(store, reference, what)
        check(k > (20 if who != "batch" else 5), f"{who}: only {k - 1} steps")
    print(f"{total} kills, each at another step")
    # The same when a damaged object is replaced, and when garbage is collected.
    for k in range(1, 60):
        store = place / "store"
        shutil.rmtree(store)
        shutil.copytree(whole, store, symlinks=True)
        asset = store / "content" / os.readlink(store / "assets/nifti.glb").split("content/")[1]
        asset.write_bytes(asset.read_bytes()[:-4] + b"DAMG")
        killed = subprocess.run([MESH, "batch", collection, "-o", store, "--verify", "--quiet"],
                                env=os.environ | {"TROCAR_FAILPOINT": f"both:{k}"}, stderr=subprocess.DEVNULL, check=False)
        if killed.returncode == 0:
            break
        batch(collection, store, "--verify")
        expect_equal(store, reference, f"--verify, kill at step {k}")


def descendants(pid):
    out = []
    for task in pathlib.Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            out += [int(child) for child in task.read_text().split()]
        except OSError:
            pass
    return out


def test_trouble(place):
    collection = small_collection(place / "scans")
    folder = collection.parent
    whole = place / "whole"
    batch(collection, whole)
    reference = snapshot(whole)

    def fresh(name):
        shutil.copytree(whole, place / name, symlinks=True)
        return place / name

    # Disk full, for all but small files: of DICOM, which is not unpacked. The larger two of four assets do not fit.
    full, store = folder / "full.json", place / "full"
    write_collection(full, [{"name": f"d{k}", "input": "phantom/dicom", "parameters": {"max-area": area}} for k, area in enumerate((50, 5, 1, 0.5))])
    batch(full, place / "not_full")
    sizes = {f"d{k}": (place / f"not_full/assets/d{k}.glb").stat().st_size for k in range(4)}
    limit = sorted(sizes.values())[1]

    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    summary = batch(full, store, expect=3, preexec_fn=limited)
    failed = {failure["scan"]: failure for failure in summary["failures"]}
    check(set(failed) == {name for name, size in sizes.items() if size > limit} and len(failed) == 2, f"a full disk: {set(failed)} of {sizes}")
    for failure in failed.values():
        check(failure["exit_code"] == 4 and "cannot be written: File too large" in failure["reason"], f"a full disk: {failure}")
    check(not strays(store), f"a full disk: left {strays(store)}")
    batch(full, store)
    expect_equal(store, snapshot(place / "not_full"), "after a full disk")
    # A store that cannot be written.
    store = fresh("forbidden")
    change_scan(collection, "nifti", lambda scan: scan.update({"parameters": {"tolerance": 0.3}}))
    (place / "file").write_text("")
    done = run(MESH, "batch", collection, "-o", place / "file/store", expect=4)
    check(done.stderr.count("\n") == 1 and "file/store" in done.stderr, f"no folder: {done.stderr}")
    if os.geteuid() == 0:
        shutil.chown(store, 65534, 65534)
        for path in store.rglob("*"):
            os.chown(path, 65534, 65534, follow_symlinks=False)
    for path in [store, *store.iterdir()]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    keys = {"user": 65534} if os.geteuid() == 0 else {}
    for path in [*place.resolve().parents, place]:
        if os.geteuid() == 0 and not path.stat().st_mode & 0o001:
            keys = None
    if keys is not None:
        done = run(MESH, "batch", collection, "-o", store, expect=4, **keys)
        check("Permission denied" in done.stderr and done.stderr.count("\n") == 1, f"no permission: {done.stderr}")
        dry = json.loads(run(MESH, "batch", collection, "-o", store, "--dry-run", "--json", **keys).stdout)
        check([s["scan"] for s in dry["stale"]] == ["nifti"], f"--dry-run of a read-only store: {dry}")
        change_scan(collection, "nifti", lambda scan: scan.pop("parameters"))
        expect_counts(json.loads(run(MESH, "batch", collection, "-o", store, "--json", **keys).stdout), 4, 0, 0, 0, "nothing to do, read-only")
    else:
        change_scan(collection, "nifti", lambda scan: scan.pop("parameters"))

    # A scan that changes while it is read: before and after it was meshed.
    source = folder / "phantom/sample.nii.gz"
    good = source.read_bytes()
    for point in ("digested", "opened", "meshed"):
        store = place / f"changing_{point}"
        process = subprocess.Popen([MESH, "batch", collection, "-o", store, "--json", "--only", "-"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, text=True, env=os.environ | {"TROCAR_FAILPOINT": f"worker:{point}:stop"})
        process.stdin.write("nifti\n")
        process.stdin.close()
        worker = wait_for_stop(process.pid)
        source.write_bytes(good[:-1] + b"x")
        os.kill(worker, signal.SIGCONT)
        output = process.stdout.read()
        check(process.wait() == 3, f"a scan that changes when {point}: {process.returncode}")
        reason = json.loads(output)["failures"][0]["reason"]
        check("phantom/sample.nii.gz: changed while the scan was read" in reason, f"a scan that changes when {point}: {reason}")
        check(not any(path.is_file() for path in (store / "content").rglob("*")), f"a scan that changes when {point}: something was stored")
        source.write_bytes(good)
        names = place / "nifti"
        names.write_text("nifti\n")
        batch(collection, store, "--only", names)

    # An interrupt: nothing is recorded as failed, and the next run goes on.
    store = place / "interrupted"
    process = subprocess.Popen([MESH, "batch", collection, "-o", store, "--jobs", "1"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               env=os.environ | {"TROCAR_FAILPOINT": "worker:opened:stop"})
    worker = wait_for_stop(process.pid)
    process.send_signal(signal.SIGTERM)
    time.sleep(0.1)
    os.kill(worker, signal.SIGCONT)
    errors = process.communicate()[1]
    check(process.returncode == 4 and "interrupted" in errors, f"SIGTERM: {process.returncode} {errors}")
    check(not any("failed" in f.read_text() for f in (store / "scans").iterdir()) and not strays(store), "SIGTERM: a failure or strays")
    left = batch(collection, store)
    check(left["made"] + left["unchanged"] == 4 and left["failed"] == 0, f"after SIGTERM: {counts(left)}")
    if os.geteuid() != 0:
        source.chmod(0)
        failure = batch(collection, place / "unreadable", expect=3)["failures"]
        check("Permission denied" in failure[0]["reason"], f"unreadable: {failure}")
        source.chmod(0o644)


def wait_for_stop(parent):
    """The stopped process among the children."""
    for _ in range(1000):
        for child in descendants(parent):
            if pathlib.Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] == "T":
                return child
        time.sleep(0.02)
    raise AssertionError("no process stopped")


def test_several(place):
    folder = place / "scans"
    folder.mkdir(parents=True)
    make_scans(PROGRAMS, folder, slices=3, size=64)
    collection = folder / "collection.json"
    scans = [{"name": f"s{k}", "input": "phantom/sample.nii.gz", "parameters": {"threshold": 150 + k}} for k in range(40)]
    write_collection(collection, scans)
    batch(collection, place / "whole")
    reference = snapshot(place / "whole")
    keys = len([p for p in reference if p.startswith("actions/")])

    store = place / "store"
    batch(collection, store)
    # Old actions that nothing leads to: some will be wanted again, by their parameters, others not.
    write_collection(collection, [{**scan, "parameters": {"threshold": 400 + k}} for k, scan in enumerate(scans)])
    batch(collection, store)
    write_collection(collection, scans)
    old = time.time() - 7200
    for path in [*(store / "actions").rglob("*.json"), *(store / "content").rglob("*")]:
        os.utime(path, (old, old))
    half = place / "half"
    half.write_text("\n".join(f"s{k}" for k in range(10)))
    command = [MESH, "batch", collection, "-o", store, "--json"]
    cleaner = subprocess.Popen([*command, "--only", half, "--gc"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    runs = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    done = []
    for process in [cleaner, *runs]:
        out, errors = process.communicate()
        check(process.returncode == 0, f"two batches and --gc: {process.returncode} {errors}")
        done.append(json.loads(out))
    removed = done[0]["gc"]["removed"]
    made = sum(one["made"] for one in done)
    print(f"two batches and --gc: {removed} files removed, {made} made, {sum(one['found'] for one in done)} found")
    check(not strays(store), f"two batches and --gc: left {strays(store)}")
    batch(collection, store, "--verify")
    check(batch(collection, store, "--gc", "--grace", 0)["gc"]["removed"] >= 0, "--gc")
    expect_equal(store, reference, "two batches and --gc, after --gc --grace 0")

    # No double work: two batches on an empty store.
    double = 0
    for k in range(3):
        store = place / f"two_{k}"
        command = [MESH, "batch", collection, "-o", store, "--json", "--jobs", "2"]
        runs = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
        made = sum(json.loads(process.communicate()[0])["made"] for process in runs)
        double += made - keys
        check(all(process.returncode == 0 for process in runs), "two batches")
        expect_equal(store, reference, "two batches")
    print(f"two batches on an empty store, three times: {double} of {3 * keys} keys computed twice")
    check(double == 0, f"{double} keys were computed twice")

    # --gc alone: what the index leads to stays, and what is young; --prune drops scans.
    store = place / "two_0"
    write_collection(collection, scans[:10])
    check(batch(collection, store, "--gc", "--grace", 0)["gc"]["removed"] == 0, "--gc keeps what another collection's scans lead to")
    check(batch(collection, store, "--gc", "--prune")["gc"]["removed"] == 0, "--gc keeps what is young")
    check(len(list((store / "scans").iterdir())) == len(list((store / "assets").iterdir())) == 10, "--prune")
    batch(collection, place / "ten")
    removed = batch(collection, store, "--gc", "--grace", 0)["gc"]
    check(removed["removed"] > 0 and removed["bytes"] > 0, f"--gc: {removed}")
    expect_equal(store, snapshot(place / "ten"), "--gc --prune")

    # A lease held by a living process: the other batch makes the other scans, and waits. (Leases of other hosts: store_test.cpp.)
    write_collection(collection, scans[:2])
    shutil.rmtree(store)
    holder = subprocess.Popen([MESH, "batch", collection, "-o", store, "--json", "--jobs", "1"], stdout=subprocess.PIPE, text=True,
                              env=os.environ | {"TROCAR_FAILPOINT": "worker:opened:stop"})
    worker = wait_for_stop(holder.pid)
    other = subprocess.Popen([MESH, "batch", collection, "-o", store, "--json"], stdout=subprocess.PIPE, text=True)
    for _ in range(500):
        if (store / "scans/s1.json").exists():
            break
        time.sleep(0.02)
    time.sleep(0.5)
    check((store / "scans/s1.json").exists() and not (store / "scans/s0.json").exists() and other.poll() is None, "the other batch waits for s0")
    os.kill(worker, signal.SIGCONT)
    # The second scan's process of the holder stops, too, unless it finds the key.
    first, second = json.loads(holder.communicate()[0]), json.loads(other.communicate()[0])
    check(first["made"] == 1 and second["made"] == 1 and second["found"] == 1, f"waited: {counts(first)}, {counts(second)}")


def test_hostile(place):
    folder = place / "scans"
    folder.mkdir(parents=True)
    make_scans(PROGRAMS, folder, slices=3, size=64)
    collection, store = folder / "collection.json", place / "store"
    schema = schema_of("collection")
    one = {"name": "a", "input": "phantom/sample.nii.gz"}
    names = ["../x", "..", ".", ".hidden", "a/b", "", "a\nb", "x" * 121, "-o", "\u00e4", "a b", "a\\b", "\x00"]
    wrong = [*({"schema": "trocar.collection/1", "scans": [{**one, "name": name}]} for name in names),
             {"schema": "trocar.collection/1"}, {"scans": []}, {"schema": "trocar.collection/2", "scans": []}, [], 7, None,
             {"schema": "trocar.collection/1", "scans": {}}, {"schema": "trocar.collection/1", "scans": [7]},
             {"schema": "trocar.collection/1", "scans": [one], "other": 1},
             *({"schema": "trocar.collection/1", "scans": [{**one, **more}]} for more in (
                 {"input": 7}, {"input": []}, {"input": [7]}, {"input": {}}, {"input": {"glob": 7}}, {"input": {"folder": "a", "glob": "b"}},
                 {"input": "a\nb"}, {"input": ""}, {"input": {"folder": "a", "series": []}}, {"other": 1}, {"parameters": []},
                 {"parameters": {"threshold": {}}}, {"parameters": {"threshold": []}}, {"parameters": {"labels": [[1]]}}, {"parameters": {"names": ""}}))]
    for value in wrong:
        collection.write_text(json.dumps(value))
        done = run(MESH, "batch", collection, "-o", store, expect=2)
        check(done.stderr.count("\n") == 1 and "collection.json: " in done.stderr and not store.exists(), f"{json.dumps(value)[:90]}: {done.stderr}")
        check(not schema.is_valid(value), f"the schema accepts {json.dumps(value)[:90]}")
    texts = ["", "{", "[" * 100000, '{"a":' * 100000, "\xff", '{"schema": "trocar.collection/1", "schema": "trocar.collection/1", "scans": []}',
             '{"schema": "trocar.collection/1", "scans": [{"name": "a", "input": "b"}, {"name": "a", "input": "c"}]}',
             '{"schema": "trocar.collection/1", "scans": [], "defaults": {"threshold": 1e999}}']
    for text in texts:
        collection.write_text(text, encoding="latin-1")
        done = run(MESH, "batch", collection, "-o", store, expect=2, errors="replace")
        check(done.stderr.count("\n") == 1 and "collection.json: " in done.stderr, f"{text[:60]}: {done.stderr[:300]}")
    write_collection(collection, [{**one, "parameters": {"treshold": 1}}])
    done = run(MESH, "batch", collection, "-o", store, expect=2)
    check("did you mean threshold?" in done.stderr and "scan a: " in done.stderr and done.stderr.count("\n") == 1, done.stderr)
    check(not store.exists(), "a store was made")
    # 1e5 scans: nothing is opened for a dry run.
    write_collection(collection, [{"name": f"n{k}", "input": f"{k}.nii"} for k in range(100000)])
    check(len(batch(collection, place / "large", "--dry-run", "--shard", "3/1000")["stale"]) == 100, "a shard of 1e5 scans")


def test_many(place):
    """N tiny scans: the batch's own memory is flat, and a second run opens no input."""
    folder = place / "scans"
    folder.mkdir(parents=True)
    make_scans(PROGRAMS, folder, slices=1, size=32)
    source = (folder / "phantom/sample.nii.gz").read_bytes()
    for k in range(ROUNDS):
        (folder / f"{k}.nii.gz").write_bytes(source)
    collection, store = folder / "collection.json", place / "store"
    write_collection(collection, [{"name": f"s{k}", "input": f"{k}.nii.gz", "parameters": {"threshold": 100 + k % 200, "min-region": 0}} for k in range(ROUNDS)])
    start = time.monotonic()
    process = subprocess.Popen([MESH, "batch", collection, "-o", store, "--json"], stdout=subprocess.PIPE, text=True)
    # A lambda's stdout is small: it is read after the end.
    sizes = []
    while process.poll() is None:
        try:
            sizes.append(int(next(line.split()[1] for line in pathlib.Path(f"/proc/{process.pid}/status").read_text().splitlines() if line.startswith("VmRSS"))))
        except (OSError, StopIteration):
            pass
        time.sleep(0.05)
    first = json.loads(process.communicate()[0])
    took = time.monotonic() - start
    check(first["made"] + first["found"] == ROUNDS, f"many: {counts(first)}")
    early, late = max(sizes[: len(sizes) // 4 + 1]), max(sizes)
    start = time.monotonic()
    second = batch(collection, store)
    again = time.monotonic() - start
    expect_counts(second, ROUNDS, 0, 0, 0, "many, second run")
    print(f"{ROUNDS} scans: {took:.1f} s, {1000 * took / ROUNDS:.2f} ms each; second run {again:.2f} s, {again / ROUNDS * 1000:.3f} s per 1000; "
          f"memory {early} kB in the first quarter, {late} kB at most")
    check(late - early < 4096, f"the batch's memory grew from {early} to {late} kB")


def test_hostile_collection_without_any_good_scan(tmp_path):
    collection = tmp_path / "collection.json"
    write_collection(collection, [{"name": f"s{k}", "input": f"nowhere/{k}.nii.gz"} for k in range(3)])
    for expected in ("3 failed", "3 known failures"):
        done = run(MESH, "batch", collection, "-o", tmp_path / "store", expect=3)
        assert expected in done.stdout
    assert "none of the scans could be made" in done.stderr
    only = tmp_path / "only"
    only.write_text("s1\n")
    run(MESH, "batch", collection, "-o", tmp_path / "store", "--only", only)
