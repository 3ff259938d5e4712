# SPDX-License-Identifier: Apache-2.0
"""The parts of scripts/report that compare and choose: what has changed, what is recommended, what
RESULTS.md and README.md get, how numbers are shown."""
import contextlib
import importlib
import io
import pathlib
import re
import subprocess
import sys

from programs import SOURCE
from sweeps import LIBRARY  # and makes the following modules known

import against
import page as html
import pipeline
import results


def report(**changed):
    row = {"id": "a", "error_mm": 0.5, "total_ms": 10.0, "total_ms_per_slice": 1.0, "triangles": 7, "speedup_ratio": 2.0, **changed}
    return {"form": "quick", "machine": {"processor": "x"}, "sections": {"s": {"rows": [{"id": "b", "error_mm": 1}, row]}}}


def test_against():
    assert against.moved(report(), report()) == ([], [], [])
    # Only times may vary. Rows are matched by id, not by position.
    assert against.moved(report(), report(total_ms=10.5, total_ms_per_slice=0.95, speedup_ratio=1.9))[0] == []
    swapped = report()
    swapped["sections"]["s"]["rows"].reverse()
    assert against.moved(report(), swapped) == ([], [], [])
    moved = against.moved(report(), report(triangles=8, total_ms=20.0, error_mm=0.501))[0]
    assert [path for path, *_ in moved] == ["s/rows/a/total_ms", "s/rows/a/triangles", "s/rows/a/error_mm"], moved
    assert moved[0][1:] == (10.0, 20.0, 2.0)
    _, gone, fresh = against.moved(report(), report(new_mm=1))
    assert gone == [] and fresh == ["s/rows/a/new_mm"]
    for path, time in (("a/total_ms", True), ("a/encode_ms_per_slice", True), ("a/area_mm2", False), ("ms/slices", False)):
        assert against.is_time(path) == time, path
    page = html.Page("t")
    against.show("old.json", report(), report(triangles=8), page)
    assert "s/rows/a/triangles" in page.text() and "s/rows/a/total_ms" not in page.text()
    with contextlib.redirect_stdout(io.StringIO()) as said:
        against.show("old.json", report(), report(triangles=14, total_ms=20.0), html.Page("t"))
    assert "1 errors, counts or bytes and 1 times changed" in said.getvalue() and said.getvalue().count("x 2\n") == 2, said.getvalue()


def test_sections():
    """All sections of the report, in this order; scripts/report builds the programs that they run."""
    import main as report_main
    sections = sorted((importlib.import_module(f"sections.{name}") for name in report_main.SECTION_NAMES), key=lambda s: s.ORDER)
    names = [section.__name__.split(".")[1] for section in sections]
    assert names == ["pipeline", "path", "meshing", "deformation", "remeshing", "device", "loop", "cutting", "scenes", "conditioning"], names
    script = (SOURCE / "scripts" / "report").read_text()
    for section in sections:
        for program in re.findall(r'context\.programs / "([\w-]+)"', pathlib.Path(section.__file__).read_text()):
            assert program in script, program
    # Sections without a test of their programs.
    import meshing
    import remeshing
    counts = {"triangles_below_min_angle": 0, "triangles_below_min_angle_at_small_input_angle": 0, "cgal_triangles_below_min_angle": 0}
    data = {"rows": [{"id": f"L3/{k}", "slices": 3, "min_angle_deg": 30, "triangles": 60, "cgal_triangles": 120, "triangles_over_cgal": 0.5,
                      "refine_ms": 1.0, "cgal_refine_ms": k, "cgal_over_ours_ratio": k, **counts} for k in (4, 5, 6)],
            "outlines": [{"id": "L3", "slices": 3, "vertices": 9, "simplify_ms": 1, "triangulate_ms": 1, "cgal_triangulate_ms": 3, "cgal_over_ours_ratio": 3}]}
    page = html.Page("t")
    meshing.show(data, page)
    assert "<svg" in page.text() and "4.0 to 6.0 times as long (median 5.0)" in page.text() and meshing.results(data)[0].endswith("0.50 of its triangles (median 0.50).")
    what = [remeshing.CUT, remeshing.READY, "replica, after the hand-over", remeshing.CAVITY, remeshing.SLICE]
    data = {"sheets": [{"triangles_removed_median": 30}],
            "rows": [{"vertices": n, "what": w, "samples": 9, "median_us": 2.0 + k, "p99_us": 5.0, "max_us": 9.0, "to_cut_ratio": 1.0 + k}
                     for n in (10000, 200000) for k, w in enumerate(what)]}
    page = html.Page("t")
    remeshing.show(data, page)
    assert "<svg" in page.text() and "overlaps 30 triangles" in page.text() and len(remeshing.results(data)) == 1


def test_recommendation():
    # Down to 0.1 mm the error falls faster than the number of triangles grows; below it is constant.
    def row(tolerance):
        wanted = pipeline.point(tolerance_mm=tolerance)
        return {**wanted, "point": wanted["id"], "scan": "phantom 12 HU", "slices": 1, "triangles": 3000 + 1000 / max(tolerance, 0.001),
                "mean_distance_mm": max(tolerance, 0.1)}
    data = {"rows": [row(t) for t in pipeline.TOLERANCES_MM]}
    assert pipeline.recommend(data)["tolerance_mm"] == 0.1
    assert len({p["id"] for p in (pipeline.point(), pipeline.point(lattice_bits=7), pipeline.point(contour="pixel"))}) == 3


def test_page(tmp_path):
    """RESULTS.md is written whole, README.md between its marks; a second run changes nothing."""
    file, page = tmp_path / "README.md", tmp_path / "RESULTS.md"
    file.write_text(f"before\n{results.BEGIN}\nold\n{results.END}\nafter\n")
    for _ in range(2):
        results.update_readme(file, "a report", ["one", "two"])
        text = file.read_text()
        assert text.startswith(f"before\n{results.BEGIN}\n- one\n- two\n\n![") and text.endswith(f"(From `scripts/report`: a report.)\n{results.END}\nafter\n")
        results.write_page(page, "a report", [("A", ["| x |"]), ("B", ["| y |", "| z |", "", "text", "| w |"])])
        assert page.read_text().endswith("Measured: a report.\n\n## A\n\n| x |\n\n## B\n\n| y |\n| z |\n\ntext\n\n| w |\n")
    readme = (SOURCE / "README.md").read_text()
    listed = readme.partition(results.BEGIN)[2].partition(results.END)[0]
    assert listed.count("\n- ") == results.HEADLINES and results.PICTURE in listed
    assert (SOURCE / results.PICTURE).stat().st_size <= 150_000
    committed = (SOURCE / "tests" / "bench" / "RESULTS.md").read_text()
    import main as report_main
    sections = [importlib.import_module(f"sections.{name}") for name in report_main.SECTION_NAMES]
    assert all(f"\n## {section.TITLE}\n" in committed and hasattr(section, "results") for section in sections)
    assert sum(hasattr(section, "headline") for section in sections) == results.HEADLINES


def test_arguments(tmp_path):
    def code(*words):
        return subprocess.run([sys.executable, "-B", LIBRARY / "main.py", "--check", *words], stderr=subprocess.DEVNULL, check=False).returncode
    assert code() == code("--full") == code("--quick", "--only", "pipeline") == 0
    (tmp_path / "no.json").write_text("{}")
    assert code("--ful") == code("--quick", "--full") == code("--only", "nothing") == code("--against", tmp_path / "no.json") == 2
    assert code("--page") == code("--readme") == 0 and code("--page", "--only", "pipeline") == 2


def test_numbers_and_tables():
    for value, shown in ((0, "0"), (0.0, "0"), (1234567, "1\u202f234\u202f567"), (0.12345, "0.123"), (1234.5, "1\u202f234"), (None, "-"), (2e-6, "2.0e-06"), (True, "yes")):
        assert html.number(value) == shown, (value, html.number(value))
    page = html.Page("<t>")
    page.table(("a<b",), [("<script>",)])
    assert "<script>" not in page.text() and "&lt;script&gt;" in page.text()
