# SPDX-License-Identifier: Apache-2.0
"""The paper's two experiments as a user runs them, on an asset
made from the sample scan (folder SCAN), checked from the recordings alone, without code of the project.

A recording must show, at the paper's 2 ms and at 1 kHz: no force until contact; then a force of K times
penetration, up to the threshold within one tick's rise; penetration F_th / K at the puncture, within one
tick's travel; no force from the puncture until the next slice. Two runs give the same bytes, a replay gives
the same torques.
"""
import json
import re

from exported import rows_of
from programs import COUNTED_RUN, NO_ALLOCATIONS, run


def check_experiment(name, rows, scene, summary, rate):
    tissue = scene.get("tissue", {})
    stiffness = tissue.get("stiffness_N_per_m", 5000.0)
    threshold = tissue.get("threshold_N", 35.0)
    heights = sorted((piece["z_m"] for piece in scene["slices"]), reverse=True)
    time = [float(row["t_s"]) for row in rows]
    tip = [float(row["tool_z_m"]) for row in rows]
    force = [float(row["fz_wanted_N"]) for row in rows]
    delivered = [float(row["fz_delivered_N"]) for row in rows]

    assert abs(time[1] - time[0] - 1 / rate) < 1e-9, f"{name}: not {rate} Hz"
    assert tip[0] > heights[0], f"{name}: the tool does not start above the slices"
    assert min(tip) < heights[-1] - threshold / stiffness, f"{name}: the tool does not come through"
    assert len(summary["punctures"]) == len(heights), f"{name}: {len(summary['punctures'])} punctures"
    assert summary["faults"] == [], f"{name}: faults {summary['faults']}"
    assert summary["allocations_in_loop"] == NO_ALLOCATIONS, f"{name}: {summary['allocations_in_loop']} allocations"
    assert summary["ticks"] == len(rows), f"{name}: {summary['ticks']} ticks, {len(rows)} rows"
    assert summary["wrench_error_max"] <= 1e-9, f"{name}: wrench error {summary['wrench_error_max']}"
    worst = max(abs(f - d) for f, d in zip(force, delivered))
    assert worst <= 1e-9 * threshold, f"{name}: delivered force is off by {worst} N"

    # In every tick the force follows from the force law and the topmost sheet that is not punctured.
    standing, peaks = list(heights), []
    for i, row in enumerate(rows):
        depth = standing[0] - tip[i] if standing else 0.0
        wanted = stiffness * max(depth, 0.0)
        if wanted > threshold:
            before, rise = force[i - 1], stiffness * (tip[i - 1] - tip[i])
            peaks.append(before)
            assert threshold - rise <= before <= threshold, f"{name}: the force before puncture is {before} N; one tick's rise is {rise} N"
            travel = tip[i - 1] - tip[i]
            assert abs(depth - threshold / stiffness) <= travel, f"{name}: punctured {depth} m deep; one tick's travel is {travel} m"
            told = summary["punctures"][len(peaks) - 1]
            assert abs(told["t_s"] - time[i]) <= 1.5 / rate, f"{name}: puncture reported at {told['t_s']} s, seen at {time[i]} s"
            assert told["hole_vertices"] >= 3, f"{name}: a hole of {told['hole_vertices']} vertices"
            standing.pop(0)
            wanted = 0.0
        assert abs(force[i] - wanted) <= 1e-9 * threshold, f"{name}: t = {time[i]} s: force {force[i]} N, the law gives {wanted} N"
    assert len(peaks) == len(heights), f"{name}: {len(peaks)} peaks"
    print(f"{name}: {len(rows)} ticks, peaks {', '.join(f'{p:.3f} N' for p in peaks)}")


def test_experiments(source, programs, asset, work):
    trocar_run = programs / "trocar-run"

    for name in ("one_slice", "three_slices"):
        scene_file = source / "runtime" / "scenes" / f"{name}.json"
        scene = json.loads(scene_file.read_text())
        needs = run(trocar_run, "check", scene_file, "--asset", asset).stdout
        # The share of the file that is read is about the share of its slices that the scene uses.
        read, of = map(float, re.search(r"([\d.]+) of its ([\d.]+) kB read", needs).groups())
        assert of == round(asset.stat().st_size / 1e3, 1) and read < 1.5 * of * len(scene["slices"]) / 35, f"{name}: {needs}"
        for rate in (500, 1000):
            record, summary = (work / f"{name}_{rate}{end}" for end in (".csv", ".json"))
            loaded = (trocar_run, scene_file, "--asset", asset, "--clock", "virtual", "--quiet")
            common = (*loaded, "--rate", rate)
            run(programs / COUNTED_RUN, *common[1:], "--record", record, "--summary", summary)
            check_experiment(f"{name} at {rate} Hz", rows_of(record), scene,
                             json.loads(summary.read_text()), rate)
            again = work / "again.csv"
            run(*common, "--record", again, "--summary", work / "shipped.json")
            assert again.read_bytes() == record.read_bytes(), f"{name} at {rate} Hz: two runs differ"
            shipped = json.loads((work / "shipped.json").read_text())
            assert shipped["allocations_in_loop"] is None, f"{name}: the shipped program counts allocations"
            replayed = work / "replayed.csv"
            run(trocar_run, "replay", scene_file, record, "--asset", asset, "--record", replayed, "--quiet")
            torques = [[row[c] for c in row if c.startswith("tau_")] for row in rows_of(record)]
            once_more = [[row[c] for c in row if c.startswith("tau_")] for row in rows_of(replayed)]
            assert len(torques[0]) == 8 and torques == once_more, f"{name} at {rate} Hz: the replay's torques differ"
