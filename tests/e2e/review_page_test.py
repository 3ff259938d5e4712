# SPDX-License-Identifier: Apache-2.0
"""review_page_test.py SOURCE PROGRAMS SCAN WORK: the pages of `trocar-mesh review` in a headless Chromium (console/drive_review.mjs): search,
filters, order and links, by keyboard and mouse. What each search must find is computed here from the store. Pictures are in WORK/pictures."""
import json
import pathlib
import re
import shutil
import sys

from chromium_page import drive, need_browser
from e2e import check, outcome
from programs import run

SOURCE, PROGRAMS, SCAN, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
MESH = PROGRAMS / "trocar-mesh"
SCANS = 500
ODD_NAMES = ["__proto__", "review", "constructor", "Head_12.a+b-c"]


def batch(store, scans):
    """Makes a store; the scan that is called missing fails."""
    file = WORK / f"{store}.json"
    file.write_text(json.dumps({"schema": "trocar.collection/1", "scans": [
        {"name": name, "input": str(SCAN / ("none.nii.gz" if name == "missing" else "sample.nii.gz")), "parameters": parameters}
        for name, parameters in scans.items()]}))
    run(MESH, "batch", file, "-o", WORK / store, "--quiet", expect=3 if "missing" in scans else 0)
    return WORK / store


def large_store(source):
    """A store of SCANS scans with a few assets: {name: {status, bytes, triangles, slices}} in the order of the pages."""
    store = WORK / "large"
    shutil.copytree(source, store, symlinks=True)
    entries = {name: json.loads((source / "scans" / f"{name}.json").read_text()) for name in ("first", "second", "third", "missing")}
    figures = {}
    for name in ("first", "second", "third"):
        info = json.loads(run(MESH, "info", source / "assets" / f"{name}.glb", "--json").stdout)
        figures[name] = {"bytes": info["bytes"], "triangles": info["triangles"], "slices": len(info["slices"])}
    shutil.rmtree(store / "scans")
    (store / "scans").mkdir()
    scans = {}
    for k, name in enumerate([f"head_{k}" for k in range(SCANS - len(ODD_NAMES))] + ODD_NAMES):
        of = "missing" if k % 40 == 7 else ("first", "second", "third")[k % 3]
        entry = entries[of] | {"name": name}
        scans[name] = {"status": "failed"} if of == "missing" else {"status": "done", **figures[of]}
        if k % 60 == 5:
            scans[name] = {"status": "damaged"}
        (store / "scans" / f"{name}.json").write_text("{" if k % 60 == 5 else json.dumps(entry))
        for folder, suffix in (("assets", "glb"), ("reports", "json")):
            if scans[name]["status"] == "done":
                (store / folder / f"{name}.{suffix}").symlink_to((store / folder / f"{of}.{suffix}").readlink())
    return store, dict(sorted(scans.items(), key=lambda scan: (scan[1]["status"] == "done", scan[0].encode())))


def natural(name):
    """Numbers by value, and letters without regard to case."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part.lower()) for part in re.split(r"(\d+)", name) if part]


def queries(scans):
    """What searches, filters and orders must find: [(state, [name])]."""
    names = list(scans)
    out = [({"name": "HEAD_12"}, [name for name in names if "head_12" in name.lower()]), ({"name": "nowhere"}, []),
           ({"name": " . "}, [name for name in names if "." in name]), ({"order": "down"}, names[::-1])]
    out += [({"show": status}, [name for name in names if scans[name]["status"] == status]) for status in ("done", "failed", "damaged")]
    out.append(({"name": "head", "sort": "name"}, sorted((name for name in names if "head" in name.lower()), key=natural)))
    for figure in ("bytes", "triangles", "slices"):
        known, unknown = [name for name in names if figure in scans[name]], [name for name in names if figure not in scans[name]]
        for order, sign in (("up", 1), ("down", -1)):
            out.append(({"sort": figure, "order": order}, sorted(known, key=lambda name, f=figure, s=sign: s * scans[name][f]) + unknown))
    return [{"state": {"name": "", "show": "all", "sort": "page", "order": "up"} | state, "names": found} for state, found in out]


def main():
    need_browser(with_console=False)
    shutil.rmtree(WORK, ignore_errors=True)
    (WORK / "pictures").mkdir(parents=True)
    scans = {"first": {"slices": "5:6"}, "second": {"slices": "5:9"}, "third": {"slices": "20:22"}, "missing": {}}
    before = batch("before", scans)
    now = batch("now", scans | {"second": {"slices": "5:9", "threshold": 180}, "new_one": {"slices": "10:10"}})
    store, large = large_store(before)
    numbers = json.loads(run(MESH, "review", store, "-o", WORK / "large.html", "--json").stdout)
    check(numbers["pages"] == ["large.html", "large-2.html", "large-3.html"], f"pages: {numbers['pages']}")
    run(MESH, "review", now, "-o", WORK / "small.html", "--against", before)
    size = {name: (now / "assets" / f"{name}.glb").stat().st_size for name in ("first", "second", "third", "new_one")}
    drive("drive_review.mjs", {
        "out": str(WORK / "pictures"), "large": (WORK / "large.html").as_uri(), "small": (WORK / "small.html").as_uri(), "scans": list(large),
        "queries": queries(large), "different": ["second", "new_one"], "by_bytes": sorted(size, key=size.get, reverse=True) + ["missing"]})
    return outcome()


sys.exit(main())
