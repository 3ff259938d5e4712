# SPDX-License-Identifier: Apache-2.0
"""HU as colours of the vertices (`--colour`), as three.js sees them and as the table of
formats/asset/asset.md says; nothing else of the asset changes; without HU the option is a usage error. SCAN is trocar-sample-ct's
folder. What three.js sees is left out where it is not installed."""
import json
import re
import shutil

from programs import PROGRAMS, SCAN, SOURCE, WORK, run

MESH, LOAD = PROGRAMS / "trocar-mesh", SOURCE / "tests" / "e2e" / "three" / "load.mjs"
SLICES = ("--slices", "10:14")


def colour_map():
    """The page's colour of a stored HU."""
    page = (SOURCE / "formats" / "asset" / "asset.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (HU|red|green|blue) \| ((?:-?\d+ \| ){8}-?\d+) \|$", page, re.MULTILINE))
    hu, *rgb = ([int(v) for v in rows[name].split("|")] for name in ("HU", "red", "green", "blue"))

    def colour(value):
        steps = (min(max(value, hu[0]), hu[-1]) - hu[0]) // 8
        i = min(steps // 32, 7)
        k = steps - 32 * i
        return [(c[i] * (32 - k) + c[i + 1] * k + 16) // 32 for c in rgb]
    return colour


def make(name, *options):
    asset = WORK / f"{name}.glb"
    run(MESH, SCAN / "dicom", "-o", asset, "--report", asset.with_suffix(".json"), "--quiet", *SLICES, *options)
    run(MESH, "verify", "--private", asset)
    return asset


def seen_by_three(asset):
    return json.loads(run("node", LOAD, asset).stdout)["slices"]


def check_colours(plain, coloured):
    plain, coloured, of_hu = seen_by_three(plain), seen_by_three(coloured), colour_map()
    assert len(coloured) == 5, f"{len(coloured)} slices"
    used = set()
    for a, b in zip(plain, coloured):
        assert not a["has_hu"] and a["colours"] is None, f"slice {a['index']}: coloured without --colour"
        assert (a["index"], a["triangles"], a["bounds"]) == (b["index"], b["triangles"], b["bounds"]), f"slice {b['index']}: another mesh"
        assert b["colours"] and len(b["colours"]) == b["vertices"], f"slice {b['index']}: a colour is missing"
        for hu, *rgb in b["colours"] or []:
            assert hu == int(hu) and hu % 8 == 0, f"slice {b['index']}: {hu} HU"
            assert rgb == of_hu(int(hu)), f"slice {b['index']}: {hu} HU is {rgb}, the page says {of_hu(int(hu))}"
            used.add(tuple(rgb))
    assert len(used) > 50, f"{len(used)} colours only"


def test_colour():
    plain, coloured = make("plain"), make("coloured", "--colour")
    make("bare", "--no-hu")
    for entry in json.loads((WORK / "coloured.json").read_text())["slices"]:
        assert abs(entry["hu_bias"]) <= 5 and entry["hu_rms"] > 0 and entry["hu_pixels"] > 0, f"the field of HU: {entry}"
    info = [json.loads(run(MESH, "info", file, "--json").stdout)["slices"] for file in (plain, coloured)]
    assert info[0] == info[1], "info tells other slices with --colour"
    if (LOAD.parent / "node_modules" / "three").is_dir() and shutil.which("node"):
        check_colours(plain, coloured)
    else:
        print("three.js is not installed: the colours were not read back")
