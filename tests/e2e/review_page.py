# SPDX-License-Identifier: Apache-2.0
"""Stores whose review console_pages_test.py searches, and what each search must find."""
import json
import re
import shutil

from programs import PROGRAMS, SCAN, WORK, run

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


def small_stores():
    """Two stores, of which the second has another scan and a changed one."""
    scans = {"first": {"slices": "5:6"}, "second": {"slices": "5:9"}, "third": {"slices": "20:22"}, "missing": {}}
    return batch("before", scans), batch("now", scans | {"second": {"slices": "5:9", "threshold": 180}, "new_one": {"slices": "10:10"}})
