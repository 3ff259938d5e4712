# SPDX-License-Identifier: Apache-2.0
"""Each benchmark once on few inputs: its own checks hold (exit code 0), and so do the properties below. Times are compared in
noise only. ctest chooses a test by -k."""
import json
import subprocess
import sys

import bench_compare
import pytest
from programs import ASSETS, PROGRAMS, SANITIZED, SCAN, SOURCE, run


def bench(work, name, *words, min_time=0.001):
    """{name: counters}, with the time in us as time_us. `words`: inputs and options."""
    out = work / f"{name}.json"
    run(PROGRAMS / name, "--quick", f"--benchmark_min_time={min_time}", "--benchmark_out_format=json", f"--benchmark_out={out}", *words)
    rows = bench_compare.read(out)
    assert rows and all(row.time_us > 0 for row in rows.values())
    return {row.name: {**row.counters, "time_us": row.time_us} for row in rows.values()}


def asset():
    if not (ASSETS / "sample.glb").is_file():
        pytest.skip("no asset")
    return f"phantom={ASSETS / 'sample.glb'}"


def falling(values):
    return all(b <= a + 1e-9 for a, b in zip(values, values[1:]))


def test_conditioning_bench(work):
    rows = bench(work, "conditioning_bench")
    assert rows["conditioning/jacobian/stated-workspace"]["error_row"] < 1e-13
    equal = rows["conditioning/allocation/about-the-limits"]
    assert equal["error_torque"] < 1e-12 and equal["error_scale"] < 1e-14
    for kind in ("minimum_norm", "null_space", "scaled"):
        assert sum(row[kind] for name, row in rows.items() if "/allocation/" in name) > 5, kind


def test_cut_bench(work):
    rows = bench(work, "cut_bench")
    assert len(rows) == 8 and 20 < rows["cut/10000-vertices/trocar"]["triangles_removed"] < 40


def test_cutting_bench(work):
    rows = bench(work, "cutting_bench")
    errors = {points: [rows[f"cutting/slabs/{points}/{n}"]["error_force"] for n in (8, 16, 64)] for points in ("two-points", "midpoint")}
    for coarse, middle, fine in errors.values():
        assert coarse > middle > fine and fine < 0.01
    # Two Gauss points are exact for a rigid rod, the midpoint errs by 1 / (n^2 - 1).
    assert rows["cutting/slabs/two-points/8"]["error_side"] < rows["cutting/slabs/midpoint/8"]["error_side"]
    steps = [rows[f"cutting/newton/two-points/{n}-steps"] for n in (1, 12)]
    assert steps[0]["error_force"] > steps[1]["error_force"] and steps[1]["error_force_max"] < 1e-4
    published = [name for name in rows if name.startswith("published/")]
    assert len(published) >= 22 and sum(name.endswith("/fitted") for name in published) == 1


def test_deformation_bench(work):
    rows = bench(work, "deformation_bench", asset())
    for method in ("propagation", "local"):
        of = [row for name, row in rows.items() if name.startswith(f"deformation/phantom/{method}/")]
        assert len(of) == 5 and falling([row["error_force_max"] for row in of]) and falling([row["error_displacement_max"] for row in of])
    of = [rows[f"deformation/phantom/local/{mm}mm"]["error_force"] for mm in (4, 48)]
    assert of[0] > 0.05 and of[1] < 1e-3


def test_device_bench(work):
    rows = bench(work, "device_bench")
    four, three = rows["workspace/stated/trocar-4-legs"], rows["workspace/stated/peer-3-legs"]
    assert four["inverse_condition_min"] > 0.15 > three["inverse_condition_min"] and four["torque_for_35N_max_Nm"] < 4.5
    exact = [rows[f"allocation/{force}N/trocar"]["exact_percent"] for force in (10, 35, 60, 140)]
    assert exact[0] == pytest.approx(100) and falling(exact) and exact[3] < 100
    assert all(rows[f"allocation/{force}N/peer-clipping"]["exact_percent"] <= e + 1 for force, e in zip((10, 35, 60, 140), exact))
    assert rows["allocation/140N/peer-clipping"]["error_direction_max_deg"] > 10


def test_mesher_bench(work):
    rows = bench(work, "mesher_bench", f"sample={SCAN / 'sample.nii.gz'}")
    for area in (50, 5, 1):
        ours, cgal = (rows[f"refine/sample/{method}/{area}mm2"] for method in ("trocar", "peer-CGAL"))
        assert ours["triangles"] < cgal["triangles"] and ours["area_change"] < 1e-3


def test_pipeline_bench(work):
    rows = bench(work, "pipeline_bench", f"path-gz={SCAN / 'sample.nii.gz'}", f"path-PNG={SCAN / 'png'}", f"path-DICOM={SCAN / 'dicom'}")
    exact, default, pixel = (rows[f"pipeline/phantom/{setting}"] for setting in ("subpixel/0mm", "subpixel/0.2mm", "peer-pixel-chains/0mm"))
    # Simplification adds at most its tolerance to the error of the exact contour. (Distances are sampled every eighth of a pixel.)
    assert 0 < exact["error_mean_mm"] < 0.005 < default["error_mean_mm"] < 0.2
    assert exact["error_hausdorff_mm"] < 0.15 and default["error_hausdorff_mm"] <= exact["error_hausdorff_mm"] + 0.2 + 3 / 256 + 0.02
    # Chains through pixel centres lie half a pixel inside on average.
    assert pixel["error_mean_mm"] > 10 * exact["error_mean_mm"] and pixel["error_area_percent"] < -2 and abs(exact["error_area_percent"]) < 0.2
    assert default["triangles"] < exact["triangles"]
    stages = {key for key in rows["path/gz/trocar"] if key.startswith("ms_")}
    assert stages >= {"ms_read", "ms_contour", "ms_simplify", "ms_triangulate", "ms_refine", "ms_check", "ms_encode", "ms_digest"}, stages
    assert "path/PNG/peer-OpenCV-decode" in rows and "path/gz/peer-inflate" in rows
    if not SANITIZED:  # the smaller slice fits into the caches, the larger one does not
        small, large = (rows[f"noise/white/trocar/{size}px"] for size in (160, 960))
        ratio = large["time_us"] / large["vertices"] / (small["time_us"] / small["vertices"])
        assert ratio < 2.5, ratio


def test_scene_bench(work):
    rows = bench(work, "scene_bench", asset(), "--benchmark_filter=/1-of", "--benchmark_repetitions=9",
                 "--benchmark_enable_random_interleaving=true", min_time=0.01)
    one, alone, whole = (rows[f"scene/phantom/{name}"] for name in ("trocar/1-of-350", "trocar/1-of-1", "peer-whole-file/1-of-350"))
    assert one["factored_nodes"] > 0 and one["read_bytes"] < one["file_bytes"] / 100
    assert one["time_us"] < 1.3 * alone["time_us"] < whole["time_us"], (one, alone, whole)


def test_scripts(work):
    """compare and plot on made-up runs."""
    def write(name, scale):
        def entry(method, us, error):
            return {"name": "x", "run_name": f"refine/head/{method}/50mm2/real_time", "run_type": "iteration", "iterations": 1, "real_time": us * scale,
                    "cpu_time": 1e9, "time_unit": "us", "error_share": error}
        entries = [entry(*row) for row in (("trocar", 10, 0.1), ("trocar", 12, 0.1), ("trocar", 11, 0.1), ("peer-CGAL", 44, 0.2 * scale))]
        (work / name).write_text(json.dumps({"benchmarks": entries}))
        return work / name
    old, new = write("old.json", 1), write("new.json", 2)
    rows = bench_compare.read(old)
    ours, cgal = rows["refine/head/trocar/50mm2"], rows["refine/head/peer-CGAL/50mm2"]
    assert ours.time_us == 11 and bench_compare.ratio_to_ours(cgal, [ours, cgal]) == 4 and bench_compare.ratio_to_ours(ours, [ours, cgal]) is None
    times, counters = bench_compare.changes(rows, bench_compare.read(new))
    assert [row[3] for row in times] == [2, 2] and [row[0] for row in counters] == ["refine/head/peer-CGAL/50mm2 error_share"]
    assert bench_compare.changes(rows, rows) == ([], [])
    library = SOURCE / "scripts" / "lib"
    said = [subprocess.run([sys.executable, "-B", library / "bench_compare.py", *args], text=True, capture_output=True, check=True).stdout
            for args in ((old,), (old, new))]
    assert "## refine" in said[0] and "head trocar 50mm2" in said[0] and "times: 2 changed" in said[1]
    subprocess.run([sys.executable, "-B", library / "bench_plot.py", old, work], capture_output=True, check=True)
    assert (work / "refine.png").stat().st_size > 1000
