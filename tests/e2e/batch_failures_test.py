# SPDX-License-Identifier: Apache-2.0
"""What trocar-mesh batch does about scans that have failed before: known failures, --retry, --strict, --max-failures, and what it says of them."""
import json

import pytest
from batch_collection import broken, make_scans, snapshot, write_collection
from programs import PROGRAMS, run

MESH = PROGRAMS / "trocar-mesh"


class Store:
    """A collection of ten broken scans and a good one, and its store after a first run."""

    def __init__(self, folder):
        make_scans(PROGRAMS, folder, slices=3, size=64)
        self.codes, scans = {}, [{"name": "good", "input": "phantom/sample.nii.gz"}]
        for name, scan, code in broken(folder):
            scans.append({"name": name, **scan})
            self.codes[name] = code
        self.collection, self.folder = folder / "collection.json", folder / "store"
        write_collection(self.collection, scans)
        assert self.summary(expect=3)["failed"] == 10

    def run(self, *options, expect=0, **keys):
        return run(MESH, "batch", self.collection, "-o", self.folder, *options, expect=expect, **keys)

    def summary(self, *options, expect=0):
        return json.loads(self.run("--json", *options, expect=expect).stdout)


@pytest.fixture(name="store", scope="module")
def first_run(tmp_path_factory):
    return Store(tmp_path_factory.mktemp("failures"))


def test_a_second_run_ends_well_and_changes_nothing(store):
    before = snapshot(store.folder)
    done = store.run()
    assert "10 known failures" in done.stdout and not done.stderr
    summary = store.summary()
    assert (summary["unchanged"], summary["failed"], summary["known"]) == (1, 0, 10)
    assert {one["scan"]: one["exit_code"] for one in summary["known_failures"]} == store.codes
    assert snapshot(store.folder) == before


def test_strict_names_them(store):
    done = store.run("--strict", "--quiet", expect=3)
    assert all(name in done.stderr for name in store.codes), done.stderr


def test_dry_run_and_explain_tell_them_from_stale_scans(store):
    dry = store.summary("--dry-run")
    assert not dry["stale"] and {one["scan"]: one["exit_code"] for one in dry["known_failures"]} == store.codes
    assert store.summary("--explain", "bad_text")["status"] == "known_failure"
    assert len(store.summary("--dry-run", "--retry")["stale"]) == 10


def test_retry_tries_them_again(store):
    summary = store.summary("--retry", expect=3)
    assert (summary["unchanged"], summary["failed"], summary["known"]) == (1, 10, 0)


def test_max_failures_ends_a_run(store, tmp_path):
    done = run(MESH, "batch", store.collection, "-o", tmp_path / "few", "--only", "-", "--jobs", "1", "--max-failures", "3", "--json", expect=3,
               input="\n".join(store.codes))
    few = json.loads(done.stdout)
    assert (few["failed"], few["left"]) == (3, 7) and "stopped after 3 failures" in done.stderr


def test_a_collection_without_any_good_scan_never_ends_well(store, tmp_path):
    collection = tmp_path / "collection.json"
    write_collection(collection, [{"name": f"s{k}", "input": f"nowhere/{k}.nii.gz"} for k in range(3)])
    for expected in ("3 failed", "3 known failures"):
        done = run(MESH, "batch", collection, "-o", tmp_path / "store", expect=3)
        assert expected in done.stdout
    assert "none of the scans could be made" in done.stderr
    only = tmp_path / "only"
    only.write_text("s1\n")
    run(MESH, "batch", collection, "-o", tmp_path / "store", "--only", only)
