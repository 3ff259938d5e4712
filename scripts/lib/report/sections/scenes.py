# SPDX-License-Identifier: Apache-2.0
"""Scene loading: what a session reads, decodes, factors and stores of an asset, by the size of the scene and the asset.

Measured by the program scene_sweep, in one process: the same slices in a separate asset and within
larger assets."""
import json
import subprocess

import scenes_plots as plots
from sections.deformation import assets

TITLE = "Scene loading: only what a scene needs"
ORDER = 60

ASSET_SLICES = (35, 350)
SCENE_SLICES = (1, 3, 35)
RATIO_BOUND, ONE_SLICE_BOUND_MS = 1.3, 5
RATIOS = ("read_bytes_relative", "load_peak_bytes_relative", "kept_bytes_relative", "load_time_ratio")


def measure(context):
    plan = {"assets": list(assets(context)), "asset_slices": ASSET_SLICES, "scene_slices": SCENE_SLICES,
            "repetitions": 101 if context.full else 41, "folder": str(context.scratch)}
    done = subprocess.run([context.programs / "scene_sweep"], input=json.dumps(plan), text=True,
                          stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def scans_of(data):
    return list(dict.fromkeys(row["scan"] for row in data["rows"]))


def show(data, page):
    one = [row for row in data["rows"] if row["scene_slices"] == 1 and row["asset_slices"] == max(ASSET_SLICES)]
    worst = {key: max(row[key] for row in one) for key in RATIOS}
    slowest_ms = max(row["load_ms"] for row in one)
    page.text_block(
        f"One slice of {max(ASSET_SLICES)}, against the same slice in a separate asset: {worst['read_bytes_relative']:.3f} times the bytes "
        f"read, {worst['load_peak_bytes_relative']:.3f} times the memory, {worst['load_time_ratio']:.2f} times the time at most "
        f"(bound: {RATIO_BOUND}), and {slowest_ms:.2f} ms (bound: {ONE_SLICE_BOUND_MS} ms): "
        f"{'both bounds are kept' if max(worst.values()) <= RATIO_BOUND and slowest_ms <= ONE_SLICE_BOUND_MS else 'NOT KEPT'}.", verdict=True)
    page.text_block(
        "Loading runs from opening the asset to sheets ready for contact: reading the slices, decoding, verifying every "
        "triangle, and the lookup grid. The files are in the page cache. Times are medians of interleaved runs; their ratio is of CPU time, which other work on the machine does not affect. Peak: the largest number of bytes on the heap "
        "while loading; kept: the bytes after it, mostly capacity for later holes (without the session's second replica). "
        "Factored: free nodes of the networks around the tool, one region per slice; 0 where the tool touches nothing.")
    page.plot(plots.loading([(scan, [row for row in data["rows"] if row["scan"] == scan],
                              [row for row in data["whole"] if row["scan"] == scan]) for scan in scans_of(data)]),
              "Reading by the number of slices that the asset has: scenes of 1, 3 and 35 slices, and the whole file.")
    page.table(("scan", "scene's slices", "asset's slices", "file kB", "read kB", "triangles decoded", "nodes factored", "peak kB", "kept kB",
                "read ms", "load ms", "bytes ratio", "peak ratio", "kept ratio", "time ratio"),
               [(row["scan"], row["scene_slices"], row["asset_slices"], row["file_bytes"] / 1e3, row["read_bytes"] / 1e3,
                 row["decoded_triangles"], row["factored_nodes"], row["load_peak_bytes"] / 1e3, row["kept_bytes"] / 1e3,
                 row["read_ms"], row["load_ms"], *(row[key] for key in RATIOS)) for row in data["rows"]],
               marked=[k for k, row in enumerate(data["rows"]) if row in one])
    page.table(("the whole file", "slices", "read kB", "peak kB", "read ms"),
               [(row["scan"], row["asset_slices"], row["read_bytes"] / 1e3, row["read_peak_bytes"] / 1e3, row["read_ms"])
                for row in data["whole"]], folded="each whole file, for comparison")


def results(data):
    lines = ["| scan | slices of the scene, of the asset | read kB | of | nodes factored | kept MB | ms to load | times bytes, memory, time of the slices alone |",
             "| --- | --- | --- | --- | --- | --- | --- | --- |"]
    for row in data["rows"]:
        if row["asset_slices"] != max(ASSET_SLICES):
            continue
        lines.append(f"| {row['scan']} | {row['scene_slices']} of {row['asset_slices']} | {row['read_bytes'] / 1e3:.1f} | {row['file_bytes'] / 1e3:.0f} | "
                     f"{row['factored_nodes']} | {row['kept_bytes'] / 1e6:.2g} | {row['load_ms']:.2g} | {row['read_bytes_relative']:.3f}, "
                     f"{row['load_peak_bytes_relative']:.3f}, {row['load_time_ratio']:.2f} |")
    lines += ["", "Loading: from the file in the page cache to sheets ready for contact."]
    return lines
