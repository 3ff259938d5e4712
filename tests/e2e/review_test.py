# SPDX-License-Identifier: Apache-2.0
"""`trocar-mesh review`: every scan of a store on its pages, and the differences from another store against
an independent computation from the exported outlines. Damaged stores give a clear line, or a card that says so."""
import json
import os
import pathlib
import re
import resource
import shutil
import urllib.parse

import numpy

from exported import conforms, read_poly
from programs import PROGRAMS, SANITIZED, SCAN, WORK, run
from html_pages import check_self_contained, embedded_json, rendered, texts_of

MESH = PROGRAMS / "trocar-mesh"
ACCURACY_MM, STEP_MM = 1e-3, 0.01  # of the program; between the points of this test
PER_PAGE = 240
PICTURE = '"data:image/png;base64,'
MANY = 2000
GROWTH_MAX_BYTES = 40e6  # from one page to nine: less than the pages' 24 MB of text and as much again


def collection(name, scans):
    file = WORK / f"{name}.json"
    file.write_text(json.dumps({"schema": "trocar.collection/1", "scans": [
        {"name": scan, "input": str(SCAN / source), "parameters": parameters} for scan, source, parameters in scans]}))
    return file


def review(store, page, *options, expect=0):
    done = run(MESH, "review", store, "-o", page, "--json", *options, expect=expect)
    if expect:
        assert len(done.stderr.strip().splitlines()) == 1 and str(store) in done.stderr, f"{store}: not one line that names it: {done.stderr}"
        return done.stderr
    numbers = json.loads(done.stdout)
    conforms("review", numbers, page.name)
    return numbers


def segments(store, name):
    """Slice: the outline's edges, an array of n x 2 x 2, mm, as `export` writes them."""
    out = WORK / "export"
    shutil.rmtree(out, ignore_errors=True)
    run(MESH, "export", store / "assets" / f"{name}.glb", "-o", out)
    slices = {}
    for file in out.glob("*.poly"):
        points, ends = read_poly(file)
        slices[int(re.search(r"_(\d+)\.poly", file.name)[1])] = points[ends]
    return slices


def one_sided(edges, others):
    """Largest distance from points on the edges, STEP_MM apart or nearer, to the other edges."""
    worst = 0.0
    a, b = others[:, 0], others[:, 1]
    along = b - a
    length2 = numpy.maximum((along ** 2).sum(1), 1e-30)
    for start, end in edges:
        count = 1 + int(numpy.hypot(*(end - start)) / STEP_MM)
        points = start + numpy.linspace(0, 1, count + 1)[:, None] * (end - start)
        t = numpy.clip(((points[:, None] - a) * along).sum(2) / length2, 0, 1)
        d2 = ((points[:, None] - a - t[..., None] * along) ** 2).sum(2).min(1).max()
        worst = max(worst, float(d2) ** 0.5)
    return worst


def test_pages_and_differences():
    first = [("same", "sample.nii.gz", {"slices": "5:6"}), ("small", "sample.nii.gz", {"slices": "5:8"}), ("large", "sample.nii.gz", {"slices": "5:8"}),
             ("fewer", "sample.nii.gz", {"slices": "20:23"}), ("gone", "sample.nii.gz", {"slices": "30:31"}),
             ("fails", "sample.nii.gz", {"slices": "12:13"}), ("works", "none.nii.gz", {})]
    second = [first[0], ("small", "sample.nii.gz", {"slices": "5:8", "tolerance": 0.1}), ("large", "sample.nii.gz", {"slices": "5:8", "threshold": 180}),
              ("fewer", "sample.nii.gz", {"slices": "20:22"}), ("fails", "none.nii.gz", {}), ("works", "sample.nii.gz", {"slices": "9:9"}),
              ("new_", "sample.nii.gz", {"slices": "10:10"})]
    before, now = WORK / "before", WORK / "now"
    run(MESH, "batch", collection("first", first), "-o", before, "--quiet", expect=3)
    run(MESH, "batch", collection("second", second), "-o", now, "--quiet", expect=3)
    page = WORK / "page.html"
    numbers = review(now, page, "--against", before)
    text = page.read_text()
    assert numbers["done"] == 6 and numbers["failed"] == 1 and numbers["damaged"] == 0 and numbers["same"] == 1, f"counts: {numbers}"
    kinds = [(one["kind"], one["scan"]) for one in numbers["differences"]]
    assert (kinds == [("failed", "fails"), ("gone", "gone"), ("changed", "fewer"), ("changed", "large"), ("changed", "small"), ("repaired", "works"),
                    ("new", "new_")]), f"not worst first: {kinds}"
    by_scan = {one["scan"]: one for one in numbers["differences"]}
    assert by_scan["fewer"]["slices_only_before"] == 1 and by_scan["fewer"]["hausdorff_mm"] == 0, f"fewer: {by_scan['fewer']}"
    for scan in ("small", "large"):
        a, b = segments(now, scan), segments(before, scan)
        wanted = max(max(one_sided(a[k], b[k]), one_sided(b[k], a[k])) for k in a)
        found = by_scan[scan]["hausdorff_mm"]
        assert wanted - ACCURACY_MM <= found <= wanted + STEP_MM / 2 and found > 0.01, f"{scan}: distance {found} mm, by points {wanted} mm"
        for store, suffix in ((now, ""), (before, "_before")):
            info = json.loads(run(MESH, "info", store / "assets" / f"{scan}.glb", "--json").stdout)
            assert (by_scan[scan]["triangles" + suffix] == info["triangles"] and by_scan[scan]["bytes" + suffix] == info["bytes"]
                  and abs(by_scan[scan]["area_mm2" + suffix] - sum(s["area_mm2"] for s in info["slices"])) < 1e-6), f"{scan}{suffix}: {by_scan[scan]}"
    assert text.count(PICTURE) == 6 + 3, f"{text.count(PICTURE)} pictures"  # of each asset, and of the earlier one where it changed
    check_self_contained("review", text)
    shown = embedded_json(text, "review")
    assert {card["name"] for card in shown["cards"]} == {scan for scan, *_ in second}, f"other scans on the page: {shown['cards']}"
    assert [{k: v for k, v in one.items() if k != "page"} for one in shown["differences"]["scans"]] == numbers["differences"], "the page has other differences"
    rendered_page(page, second, kinds)
    other = WORK / "page-2.html"  # the page of another review, which has the name of a second page of this one
    review(before, other)
    kept = other.read_bytes()
    review(now, page, "--against", before)
    assert other.exists() and other.read_bytes() == kept, "the page of another review is gone"
    again = WORK / "again.html"
    review(now, again, "--against", before)
    assert again.read_text().replace("again.html", "page.html") == text, "the same review gives other bytes"


def rendered_page(page, scans, kinds):
    """What the reader sees: a card for each scan, and a row for each difference, linked to its card."""
    dom = rendered(page)
    if dom is None:
        return
    assert dom.count("<img ") == 9 and dom.count('loading="lazy"') == 9, f"{dom.count('<img ')} pictures, or they are not loaded lazily"
    texts = texts_of(dom)
    for scan, *_ in scans:
        assert f'id="{scan}"' in dom, f"{scan} has no card"
    for kind, scan in kinds:
        assert kind in texts and scan in texts, f"{scan}: {kind} is not in the table"
        assert (f'href="{page.name}#{scan}"' in dom) == (kind != "gone"), f"{scan}: the link to the card"
    assert dom.count("<tr>") == 1 + len(kinds), f"{dom.count('<tr>')} rows"


def test_hostile_texts():
    """Texts of a damaged store's entry stand on the page as text."""
    store = WORK / "hostile"
    shutil.copytree(WORK / "before", store, symlinks=True)
    entry = store / "scans" / "works.json"
    index = json.loads(entry.read_text())
    index["reason"] = hostile = "</script><img src=x onerror=alert(1)><!--\u2028x"
    entry.write_text(json.dumps(index))
    page = WORK / "hostile.html"
    review(store, page)
    assert hostile not in page.read_text() and any(card.get("reason") == hostile for card in embedded_json(page.read_text(), "review")["cards"]), "a hostile text is not escaped, or is lost"
    dom = rendered(page)
    assert dom is None or (hostile in texts_of(dom) and "<img src=\"x\"" not in dom), "a hostile text is not shown as text"


def linked(page, href):
    """The file to which a browser goes that has opened the page by this path."""
    address = urllib.parse.urlsplit(urllib.parse.urljoin(page.absolute().as_uri(), href))
    assert address.scheme == "file" and not address.fragment and not address.query, f"{href}: not a file's address"
    return pathlib.Path(urllib.parse.unquote(address.path))


def test_links():
    """The links of each card lead to the files of its scan, wherever page and store lie."""
    store = WORK / "a b#c%?\u00e9+'"
    shutil.copytree(WORK / "before", store, symlinks=True)
    deep, folder_link, store_link = WORK / "deep" / "x:y &" / "er", WORK / "folder_link", WORK / "store_link"
    deep.mkdir(parents=True)
    folder_link.symlink_to(deep)
    store_link.symlink_to(store)
    relative = 0
    for page, given in ((WORK / "links.html", store), (store / "links.html", store), (deep / "links.html", store), (folder_link / "links.html", store),
                        (folder_link / ".." / "links.html", store), (WORK / "links.html", store_link), (folder_link / "links.html", WORK / "deep" / ".." / store.name),
                        (WORK / "links.html", f"{store}/"), (pathlib.Path(os.path.relpath(deep / "links.html")), pathlib.Path(os.path.relpath(store)))):
        review(given, page)
        cards = {card["name"]: card for card in embedded_json(page.read_text(), "review")["cards"]}
        for name, card in cards.items():
            assert set(card.get("links", {})) == ({"report", "asset"} if name != "works" else set()), f"{page}: {name}: {card.get('links')}"
            for kind, href in card.get("links", {}).items():
                wanted = store / {"report": f"reports/{name}.json", "asset": f"assets/{name}.glb"}[kind]
                relative += not href.startswith("file:")
                for opened in {page.resolve(), page.absolute() if ".." not in page.parts else page.resolve()}:
                    assert linked(opened, href).samefile(wanted), f"{opened}: the {kind} of {name} is {href}"
    assert relative == 7 * 12, f"{relative} relative links"  # all but those of the two pages in a symbolic link to a folder
    dom = rendered(WORK / "links.html")
    assert dom is None or dom.count('aria-label="report of same"') == 1, "links are not shown"


def test_damaged():
    good = WORK / "before"
    for what in ("truncated", "other bytes", "missing", "entry", "entry path", "entry size"):
        store = WORK / "damaged"
        shutil.rmtree(store, ignore_errors=True)
        shutil.copytree(good, store, symlinks=True)
        entry = store / "scans" / "same.json"
        asset = (store / "assets" / "same.glb").resolve()
        index = json.loads(entry.read_text())
        if what == "truncated":
            os.truncate(asset, 100)
        elif what == "other bytes":
            asset.write_bytes(bytes(asset.stat().st_size))
        elif what == "missing":
            asset.unlink()
        elif what == "entry":
            entry.write_bytes(b"{\"schema\": \"trocar.scan/1\", \xff")
        elif what == "entry path":
            index["asset"]["sha256"] = "../../../../../etc/passwd"
            entry.write_text(json.dumps(index))
        else:
            index["asset"]["bytes"] = 1 << 60
            entry.write_text(json.dumps(index))
        page = WORK / "damaged.html"
        numbers = review(store, page)
        assert numbers["damaged"] >= 1 or what == "entry size", f"{what}: damaged: {numbers}"
        cards = embedded_json(page.read_text(), "review")["cards"]
        assert any("error" in card.get("asset", {}) or "reason" in card and card["name"] == "same" for card in cards) or what == "entry size", f"{what}: the page does not say so"
        for pair in ((store, good), (good, store)):
            numbers = review(pair[0], page, "--against", pair[1])
            kinds = {one["scan"]: one["kind"] for one in numbers["differences"]}
            assert set(kinds) <= {"same"}, f"{what}: {kinds}"
    (WORK / "no_store").mkdir()
    (WORK / "no_store" / "trocar-store.json").write_text('{"schema": "trocar.store/9"}')
    run(MESH, "review", WORK / "no_store", "-o", WORK / "x.html", expect=2)
    (WORK / "no_store" / "trocar-store.json").write_text('{"schema": "trocar.store/1"}')
    assert "no scans" in review(WORK / "no_store", WORK / "x.html", expect=3), "an empty store"
    assert not (WORK / "x.html").exists(), "a page without a review"


def refused_over(store, page, file, text):
    """A file with the name of a later page that belongs to something else is kept, and nothing is written."""
    file.write_text(text)
    first = page.read_bytes()
    done = run(MESH, "review", store, "-o", page, expect=4)
    assert done.stderr == (f"trocar-mesh: {file}: exists, and is not a page of {page}; choose another name for the review, "
                           "or remove the file\n"), done.stderr
    assert file.read_text() == text and page.read_bytes() == first, "a refused review has written"
    file.unlink()


def test_many():
    """Memory does not grow with the number of pages, and none of a longer review is left."""
    store = WORK / "many"
    few = collection("few", [("small", "sample.nii.gz", {"slices": "5:8"})])
    run(MESH, "batch", few, "-o", store, "--quiet")
    entry = json.loads((store / "scans" / "small.json").read_text())
    peaks = []
    review(store, WORK / "before_many.html")
    page = WORK / "many.html"
    for count in (PER_PAGE, MANY):
        for file in (store / "scans").iterdir():
            file.unlink()
        for k in range(count):
            entry["name"] = f"copy{k:05}"
            (store / "scans" / f"copy{k:05}.json").write_text(json.dumps(entry))
        if count > PER_PAGE:
            for others in ("somebody's page", (WORK / "before_many.html").read_text()):
                refused_over(store, page, WORK / "many-3.html", others)
        numbers = review(store, page)
        if count > PER_PAGE:
            odd = WORK / "many <b>&.html"  # the second review finds its own pages
            assert review(store, odd)["pages"] == review(store, odd)["pages"]
        assert numbers["done"] == count and len(numbers["pages"]) == -(-count // PER_PAGE), f"{count} scans: {numbers}"
        assert all((WORK / name).stat().st_size < 6e6 for name in numbers["pages"]), f"{count} scans: a large page"
        assert sum((WORK / name).read_text().count(PICTURE) for name in numbers["pages"]) == count, f"{count} scans: pictures"
        peaks.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)
    assert SANITIZED or peaks[1] - peaks[0] < GROWTH_MAX_BYTES, f"memory grows from {peaks[0] / 1e6:.0f} to {peaks[1] / 1e6:.0f} MB"
    print(f"peak memory {peaks[0] / 1e6:.0f} MB for {PER_PAGE} scans, {peaks[1] / 1e6:.0f} MB for {MANY}")
    kept = WORK / "many-11.html"
    kept.write_text("not a review")
    for file in list((store / "scans").iterdir())[PER_PAGE:]:
        file.unlink()
    review(store, page)
    assert sorted(file.name for file in WORK.glob("many[-.]*html")) == ["many-11.html", "many.html"], f"left: {sorted(WORK.glob('many[-.]*html'))}"
