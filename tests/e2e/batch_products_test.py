# SPDX-License-Identifier: Apache-2.0
"""Products of trocar-mesh batch: preview, surface, scene and check of each scan, each made again only if what it is made of has changed."""
import json
import os
import signal
import subprocess
import time

import pytest
from programs import PROGRAMS, WORK, run

MESH = PROGRAMS / "trocar-mesh"
FILES = {"preview": "preview.png", "surface": "surface.stl", "scene": "scene.json", "check": "check.txt"}
ALL = ["check", "scene", {"product": "surface", "parameters": {"surface-triangles": 2000}}, "preview"]


def write(file, scans, products=None):
    file.write_text(json.dumps({"schema": "trocar.collection/1", "scans": scans, **({"products": products} if products is not None else {})}))


def batch(collection, store, *options, expect=0):
    return json.loads(run(MESH, "batch", collection, "-o", store, "--json", *options, expect=expect).stdout or "{}")


def targets(store, scan="a"):
    """What the links of a scan's products lead to."""
    return {name: os.readlink(store / "products" / scan / file) for name, file in FILES.items() if (store / "products" / scan / file).is_symlink()}


def journal(store):
    return [json.loads(line) for file in (store / "journal").iterdir() for line in file.read_text().splitlines()]


def strays(store):
    return [path.name for top in ("tmp", "claims") for path in (store / top).iterdir()]


@pytest.fixture(name="scans")
def new_scans(tmp_path):
    run(PROGRAMS / "trocar-sample-ct", tmp_path / "phantom", "--slices", 9, "--size", 96, "--quiet")
    return [{"name": "a", "input": "phantom/sample.nii.gz"}, {"name": "b", "input": {"folder": "phantom/dicom", "series": 1}, "parameters": {"threshold": 200}}]


def test_all_products_and_only_the_changed_one(tmp_path, scans):
    collection, store = tmp_path / "collection.json", tmp_path / "store"
    write(collection, scans, ALL)
    first = batch(collection, store)
    assert (first["made"], first["products_made"]) == (2, 8), first
    assert not strays(store)
    for scan in ("a", "b"):
        assert sorted(targets(store, scan)) == sorted(FILES)
    files = store / "products" / "a"
    assert (files / "preview.png").read_bytes().startswith(b"\x89PNG")
    assert "dry run" in (files / "check.txt").read_text()
    scene = json.loads((files / "scene.json").read_text())
    assert (files / scene["asset"]).resolve() == (store / "assets" / "a.glb").resolve()
    run(PROGRAMS / "trocar-run", files / "scene.json", "--check")  # works from the store as it is
    by_hand = tmp_path / "by_hand.stl"
    run(MESH, tmp_path / "phantom/sample.nii.gz", "--surface", "--surface-triangles", 2000, "-o", by_hand, "--quiet")
    assert (files / "surface.stl").read_bytes() == by_hand.read_bytes()

    again = batch(collection, store)
    assert (again["unchanged"], again["made"], again["products_made"]) == (2, 0, 0), again

    before, lines = targets(store), len(journal(store))
    changed = [*ALL[:2], {"product": "surface", "parameters": {"surface-triangles": 1000}}, ALL[3]]
    scans[0]["products"] = changed
    write(collection, scans, ALL)
    why = batch(collection, store, "--explain", "a")["why"]
    assert why == [{"cause": "product", "product": "surface", "what": "its parameters have changed"}], why
    third = batch(collection, store)
    assert (third["unchanged"], third["made"], third["products_made"]) == (1, 1, 1), third
    after = targets(store)
    assert {name for name in FILES if before[name] != after[name]} == {"surface"}, (before, after)
    assert [row["scan"] for row in journal(store)[lines:]] == ["a"] or len(journal(store)) == lines + 1

    # A misspelt parameter is wrong usage, as it is for a scan, and the store keeps what it has.
    write(collection, scans, [*ALL[:2], {"product": "surface", "parameters": {"surface-triangle": 1000}}, ALL[3]])
    said = run(MESH, "batch", collection, "-o", store, expect=2).stderr
    assert "scan b, product surface: parameter surface-triangle: no such option, did you mean surface-triangles?" in said, said
    assert targets(store) == after

    # As it was before: found in the store.
    del scans[0]["products"]
    write(collection, scans, ALL)
    assert batch(collection, store)["products_made"] == 0
    assert targets(store) == before


def test_an_input_changes_its_products_and_what_is_not_wanted_goes(tmp_path, scans):
    collection, store = tmp_path / "collection.json", tmp_path / "store"
    write(collection, scans[:1], ALL)
    batch(collection, store)
    before = targets(store)
    scans[0]["parameters"] = {"threshold": 250}
    write(collection, scans[:1], ALL)
    summary = batch(collection, store)
    assert summary["made"] == 1 and summary["products_made"] == 4, summary
    assert all(before[name] != after for name, after in targets(store).items())
    write(collection, scans[:1], ["preview"])
    assert batch(collection, store)["products_made"] == 0
    assert list(targets(store)) == ["preview"]
    assert batch(collection, store)["unchanged"] == 1
    removed = batch(collection, store, "--gc", "--grace", 0)["gc"]["removed"]
    assert removed >= 10, removed  # the asset, report and products of the earlier threshold, and three products of this one
    assert batch(collection, store, "--verify")["unchanged"] == 1
    write(collection, [])
    batch(collection, store, "--gc", "--prune", "--grace", 0)
    assert not list((store / "products").iterdir())


def test_a_damaged_product_is_made_again(tmp_path, scans):
    collection, store = tmp_path / "collection.json", tmp_path / "store"
    write(collection, scans[:1], ["preview", "scene"])
    batch(collection, store)
    good = {name: (store / "products/a" / FILES[name]).read_bytes() for name in ("preview", "scene")}
    scene = (store / "products/a/scene.json").resolve()
    scene.chmod(0o644)
    scene.write_bytes(good["scene"][:-2] + b"  ")
    (store / "products/a/preview.png").resolve().unlink()
    summary = batch(collection, store, "--verify")
    assert summary["products_made"] == 2, summary
    assert {name: (store / "products/a" / FILES[name]).read_bytes() for name in good} == good


def test_a_product_that_fails_leaves_the_asset_and_is_known(tmp_path, scans):
    collection, store = tmp_path / "collection.json", tmp_path / "store"
    write(collection, scans[:1], ["preview", {"product": "scene", "parameters": {"entry": "900,900,0"}}, "check"])
    done = run(MESH, "batch", collection, "-o", store, "--json", expect=3)
    first = json.loads(done.stdout)
    assert [one["scan"] for one in first["failures"]] == ["a"] and first["failures"][0]["reason"].startswith("scene: "), first
    assert "/tmp/" not in first["failures"][0]["reason"], "it would differ from store to store"
    assert (store / "assets/a.glb").exists() and list(targets(store)) == ["preview"]
    again = batch(collection, store)
    assert (again["known"], again["failed"], again["products_made"]) == (1, 0, 0), again
    # --verify also checks the assets of such scans.
    asset = (store / "assets/a.glb").resolve()
    good = asset.read_bytes()
    asset.chmod(0o644)
    asset.write_bytes(good[:700] + bytes([good[700] ^ 4]) + good[701:])
    verified = batch(collection, store, "--verify")
    assert (verified["known"], verified["failed"]) == (1, 0) and (store / "assets/a.glb").read_bytes() == good, verified
    assert batch(collection, store, "--retry", expect=3)["failed"] == 1
    write(collection, scans[:1], ["preview", "scene", "check"])
    mended = batch(collection, store)
    assert (mended["made"], mended["products_made"]) == (1, 2), mended


def test_a_product_that_fails_for_want_of_space_is_tried_again(tmp_path, scans):
    collection, store, full = tmp_path / "collection.json", tmp_path / "store", os.environ | {"TMPDIR": "/proc"}
    write(collection, scans[:1])
    batch(collection, store)
    write(collection, scans[:1], ["preview"])
    failure = json.loads(run(MESH, "batch", collection, "-o", store, "--json", expect=3, env=full).stdout)["failures"][0]
    assert failure["exit_code"] == 3 and failure["reason"].startswith("preview: ") and "set TMPDIR" in failure["reason"], failure
    again = batch(collection, store)
    assert (again["known"], again["products_made"]) == (0, 1), again
    # Only the batch asks for another exit code.
    run(MESH, "preview", tmp_path / "phantom/sample.nii.gz", "-o", tmp_path / "preview.png", expect=3, env=full)


@pytest.mark.parametrize("products, said", [
    ("preview", "/products: must be an array"), (["x"], "/products/0: must be preview, surface, scene or check"), (["check"], "check needs scene"),
    (["scene", {"product": "scene"}], "scene is given twice"), ([{"product": "preview", "parameters": {"output": "/etc/x"}}], "is not for products"),
    ([{"product": "preview", "parameters": {"-o": "x"}}], "is not for products"), ([{"product": "scene", "parameters": {"threshold": {}}}], "must be a number"),
    ([{"product": "surface", "parameters": {"mask": "seg.nii.gz:22"}}], "because it names a file; give it to the scan"),
    ([{"product": "preview", "parameters": {"names": "names.json"}}], "because it names a file; give it to the scan"),
    (["scene", {"product": "check", "parameters": {"device-description": "device.json"}}], "because it names a file"),
    # What the programs that make the products say about their options.
    ([{"product": "scene", "parameters": {"force-law": "hooke"}}], "scan a, product scene: --force-law: has no effect with --new-scene"),
    ([{"product": "scene", "parameters": {"entri": "1,2,3"}}], "scan a, product scene: not expected: --entri=1,2,3, did you mean --entry?"),
    ([{"product": "scene", "parameters": {"entry": "1,2"}}], "scan a, product scene: --entry 1,2: must be three numbers"),
    (["scene", {"product": "check", "parameters": {"live-hand": True}}], "scan a, product check: --live-hand: is for --new-scene"),
    ([{"product": "preview", "parameters": {"treshold": 300}}], "scan a, product preview: not expected: --treshold=300, did you mean --threshold?"),
    ([{"product": "preview", "other": 1}], "unknown key"), ([7], "/products/0")])
def test_wrong_products_are_refused(tmp_path, scans, products, said):
    collection = tmp_path / "collection.json"
    write(collection, scans, products)
    done = run(MESH, "batch", collection, "-o", tmp_path / "store", expect=2)
    assert said in done.stderr and done.stderr.count("\n") == 1 and not (tmp_path / "store").exists(), done.stderr


def test_presets_apply_to_products(tmp_path, scans):
    collection, store = tmp_path / "collection.json", tmp_path / "store"
    for scan in scans:
        scan["parameters"] = {"preset": "bone"}
    write(collection, scans, ["preview", "surface"])
    assert batch(collection, store)["products_made"] == 4


def test_options_of_the_asset_apply_to_the_asset_alone(tmp_path, scans):
    collection, store = tmp_path / "collection.json", tmp_path / "store"
    scans[0]["parameters"] = {"lines": True, "colour": True, "context": 3}
    write(collection, scans[:1], ["preview", "surface"])
    assert batch(collection, store)["products_made"] == 2


def test_without_trocar_run(tmp_path, scans):
    collection = tmp_path / "collection.json"
    write(collection, scans[:1], ["scene"])
    done = run(MESH, "batch", collection, "-o", tmp_path / "store", "--run-program", "/nowhere", expect=2)
    assert "--run-program /nowhere" in done.stderr and done.stderr.count("\n") == 1, done.stderr
    write(collection, scans[:1], ["preview"])
    batch(collection, tmp_path / "store", "--run-program", "/nowhere")


def test_a_kill_leaves_nothing_half_made(tmp_path, scans):
    collection, whole, store = tmp_path / "collection.json", tmp_path / "whole", tmp_path / "store"
    write(collection, scans, ALL)
    batch(collection, whole)
    for delay_s in (0.1, 0.3, 0.5, 0.8, 1.2):
        process = subprocess.Popen([MESH, "batch", collection, "-o", store, "--quiet"], stderr=subprocess.DEVNULL)
        time.sleep(delay_s)
        process.send_signal(signal.SIGKILL)
        process.wait()
    time.sleep(0.2)
    batch(collection, store)
    assert not strays(store)
    for scan in ("a", "b"):
        assert targets(store, scan) == targets(whole, scan)
        assert (store / "scans" / f"{scan}.json").read_text() == (whole / "scans" / f"{scan}.json").read_text()
