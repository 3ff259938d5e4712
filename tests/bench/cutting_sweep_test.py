# SPDX-License-Identifier: Apache-2.0
"""Small sweeps, whose results must have known properties; and
the report makes a page and CSV files of them."""
import csv
import json
import pathlib
import tempfile

from sweeps import sweep


def test_cutting_sweep():
    plan = {"slabs": [8, 16, 64], "reference_slabs": 256, "most_steps": [1, 3, 12], "ticks": 600, "repetitions": 1,
            "stability": {"sessions": 8, "damping": [0, 0.5, 1, 2], "ratio": [0.1, 0.5, 2]}}
    data, midpoint = (json.loads(sweep(program, plan).stdout) for program in ("cutting_sweep", "cutting_sweep_midpoint"))
    data["pareto"] += midpoint["pareto"]
    of = {(row["setting"], row["value"], row["points_a_slab"]): row for row in data["pareto"]}
    assert len(of) == len({row["id"] for row in data["pareto"]}) == 12
    # Finer is nearer, and so are more steps.
    for points in (1, 2):
        coarse, middle, fine = (of["slabs", n, points]["error_rms"] for n in (8, 16, 64))
        assert coarse > middle > fine and fine < 0.01, (coarse, middle, fine)
        assert of["Newton steps", 1, points]["error_rms"] > of["Newton steps", 12, points]["error_rms"]
    assert of["Newton steps", 12, 2]["error_max"] < 1e-4
    # Two Gauss points are exact for a rigid rod, the midpoint errs by 1 / (n^2 - 1).
    assert of["slabs", 8, 2]["side_error_rms"] < of["slabs", 8, 1]["side_error_rms"]

    given = {(row["kind"], row["value"]): row["given_J"] for row in data["stability"]}
    assert given["damping", 0] > 1e-4 and given["held", 0.1] > 1e-4, given
    assert max(given["damping", 1], given["damping", 2], given["predicted", 0.1], given["predicted", 0.5]) <= 1e-9, given

    table = data["published_forces"]
    rows = table["rows"]
    assert sum(row["standing"] == "fitted" for row in rows) == 1
    counted = [row for row in rows if row["standing"] == "counted"]
    for parts in (table["by_mechanism"], table["by_study"]):
        assert sum(each["rows"] for each in parts) == len(counted) >= 20
        assert sum(each["hits"] for each in parts) == sum(row["is_hit"] for row in counted)
    table["commit"] = "abc"
    import cutting  # brings matplotlib
    import page as html
    page = html.Page("t")
    cutting.show(data, page)
    missed = sum(not row["is_hit"] for row in rows)
    assert missed > 0 and page.text().count("missed") >= missed and page.text().count("<svg") == 3
    assert len(cutting.results(data)) == 2 + len(rows)
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "pareto.csv"
        cutting.write_csv(data["pareto"], path)
        with open(path, newline="", encoding="utf-8") as file:
            assert [row["id"] for row in csv.DictReader(file)] == [row["id"] for row in data["pareto"]]

    assert sweep("cutting_sweep", "{}").returncode == 2 and sweep("cutting_sweep", "x").returncode == 2
    assert sweep("cutting_sweep", {**plan, "ticks": 0}).returncode == 2
