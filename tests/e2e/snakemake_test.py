# SPDX-License-Identifier: Apache-2.0
"""scripts/snakemake/Snakefile makes the store that `trocar-mesh batch` makes; and previews, surfaces, scenes and checks, each again only if what it
is made of has changed. (Killed runs: farm_test.py.) Skipped without Snakemake (scripts/setup farm)."""
import json
import shutil
import time

import pytest

from batch_collection import collection_of_samples, difference, snapshot, strays
from e2e import check
from programs import PROGRAMS, SCAN, SOURCE, WORK, run

pytestmark = pytest.mark.skipif(shutil.which("snakemake") is None, reason="Snakemake is not installed (scripts/setup farm)")
SCANS = 100
MESH = PROGRAMS / "trocar-mesh"
FILES = {"preview": "preview.png", "surface": "surface.stl", "scene": "scene.json", "check": "check.txt"}


def command(collection, store, *config):
    return ["snakemake", "-s", str(SOURCE / "scripts/snakemake/Snakefile"), "--cores", "2", "--keep-going", "--nolock", "--rerun-incomplete", "--config",
            f"collection={collection}", f"store={store}", f"program={MESH}", f"run={PROGRAMS / 'trocar-run'}", "scans_per_job=5", *config]


def test_products():
    """What is made of two scans beside their assets; a third scan cannot be meshed."""
    folder, store = WORK / "products", WORK / "store of products"
    run(PROGRAMS / "trocar-sample-ct", folder / "phantom", "--slices", 9, "--size", 96, "--quiet")
    scans = [{"name": "a", "input": "phantom/sample.nii.gz", "parameters": {"lines": True}}, {"name": "bad", "input": "none.nii.gz"},
             {"name": "b", "input": {"folder": "phantom/dicom", "series": 1}, "parameters": {"threshold": 200}}]

    def remade(triangles=2000):
        """Runs Snakemake and returns the products, as in "a/preview.png", that it made."""
        (folder / "c.json").write_text(json.dumps({"schema": "trocar.collection/1", "defaults": {"tolerance": 0.2}, "scans": scans}))
        before = {path: path.stat().st_mtime_ns for path in store.glob("products/*/*")}
        run(*command(folder / "c.json", store, "products=preview surface scene check", f"surface_options=--surface-triangles {triangles}"), cwd=WORK)
        return {f"{path.parent.name}/{path.name}" for path in store.glob("products/*/*") if before.get(path) != path.stat().st_mtime_ns}

    made = remade()
    check(made == {f"{scan}/{file}" for scan in "ab" for file in FILES.values()}, f"products: {made}")
    scene = store / "products/a/scene.json"
    check(json.loads(scene.read_text())["asset"] == "../../assets/a.glb", "the scene does not name the asset's link")
    run(PROGRAMS / "trocar-run", "check", scene)
    check("dry run" in (store / "products/a/check.txt").read_text() and (store / "products/b/preview.png").read_bytes()[:4] == b"\x89PNG", "check or preview")
    run(MESH, folder / "phantom/sample.nii.gz", "--tolerance", 0.2, "--surface", "--surface-triangles", 2000, "-o", folder / "by_hand.stl", "--quiet")
    check((store / "products/a/surface.stl").read_bytes() == (folder / "by_hand.stl").read_bytes(), "the surface is another one")
    run(MESH, "batch", folder / "c.json", "-o", store, "--rehash", "--quiet")  # renews the times of all files
    check(not (made := remade()), f"made again without a reason: {made}")
    check((made := remade(triangles=1000)) == {"a/surface.stl", "b/surface.stl"}, f"another option: {made}")
    scans[0]["parameters"]["threshold"] = 250
    check((made := remade(triangles=1000)) == {f"a/{file}" for file in FILES.values()}, f"another threshold: {made}")


def test_store():
    collection, bad = collection_of_samples(WORK / "collection's", SCAN, SCANS, 5)
    time.sleep(2.1)  # an input younger than that is read again
    run(MESH, "batch", collection, "-o", WORK / "batch", "--quiet", expect=3)
    wanted = snapshot(WORK / "batch")

    done = run(*command(collection, WORK / "store"), cwd=WORK)
    check(f"0 of {SCANS} scans are stale, {len(bad)} are known failures" in done.stdout, f"summary: {done.stdout[-300:]}")
    check(not difference(snapshot(WORK / "store"), wanted) and not strays(WORK / "store"), "not as batch makes it")
    before = {path: path.lstat().st_mtime_ns for path in (WORK / "store").rglob("*")}
    again = run(*command(collection, WORK / "store"), cwd=WORK)
    check(f"0 of {SCANS} scans are stale" in again.stdout and "rule scans" not in again.stderr, f"a second run: {again.stderr[-300:]}")
    check(before == {path: path.lstat().st_mtime_ns for path in (WORK / "store").rglob("*")}, "a second run wrote something")
