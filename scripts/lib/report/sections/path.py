# SPDX-License-Identifier: Apache-2.0
"""From files to an asset: each stage of trocar-mesh beside the least time that it could take on this machine.

Measured by the program path_bounds, on one thread, with files in the page cache: the sample as DICOM, NIfTI and PNG, and real
scans as .nii.gz and .nii."""
import gzip
import json
import shutil
import subprocess

import path_plots as plots

TITLE = "Path: each stage beside its bound"
ORDER = 12


BONE_HU = 226


def plan(context):
    geometry = json.loads((context.sample / "sample.json").read_text())
    low, high = geometry["png_window_HU"]
    inputs = [{"id": "sample, DICOM", "path": str(context.sample / "dicom"), "threshold": BONE_HU},
              {"id": "sample, .nii.gz", "path": str(context.sample / "sample.nii.gz"), "threshold": BONE_HU},
              {"id": "sample, PNG", "path": str(context.sample / "png"), "threshold": (BONE_HU - low) / (high - low) * 255, "spacing_mm": geometry["spacing_mm"]}]
    if context.head_ct is not None:
        plain = context.scratch / "head.nii"
        with gzip.open(context.head_ct) as packed, open(plain, "wb") as out:
            shutil.copyfileobj(packed, out)
        inputs += [{"id": "head, .nii.gz", "path": str(context.head_ct), "threshold": BONE_HU}, {"id": "head, .nii", "path": str(plain), "threshold": BONE_HU}]
    return {"repetitions": 15 if context.full else 5, "inputs": inputs}


def measure(context):
    done = subprocess.run([context.programs / "path_bounds"], input=json.dumps(plan(context)), text=True, stdout=subprocess.PIPE, check=True)
    data = json.loads(done.stdout)
    (context.scratch / "head.nii").unlink(missing_ok=True)
    return data


def bound_of(row):
    return sum(stage.get("bound_ms", 0) for stage in row["stages"])


def show(data, page):
    rows = data["rows"]
    page.text_block("Whole paths over the sum of their bounds: " + "; ".join(f"{row['id']} {row['total_ms'] / bound_of(row):.1f}" for row in rows) + ".", verdict=True)
    page.text_block(f"One thread, files in the page cache, medians. The bound of a stage is the least that it must do: inflate (ISA-L), Draco and BLAKE2b alone on "
                    f"the same bytes, or the bytes that it must read and write at the speed of memcpy, {data['copied_GB_per_s']:.1f} GB/s of both together. Bytes "
                    "of contour, outline and mesh are few, so that the bounds of the stages between are far below what any search among them takes; the section on "
                    "meshing has CGAL's times for them. `encode` also decodes what Draco wrote and proves it. The digest is made only with a key, and is made here. A gzip is unpacked by a thread of its own: "
                    "`unpack` is the time that meshing waits for it, which may be less than inflate alone.")
    page.plot(plots.stages(rows), "Bars: the stage; black lines: its bound. Stages of less than 1 % of their path are left out.")
    for row in rows:
        page.table(("stage", "ms", "% of the path", "bound ms", "bound by", "over the bound", "left to gain ms"),
                   [(stage["id"], stage["ms"], 100 * stage["ms"] / row["total_ms"], stage.get("bound_ms"), stage.get("bound", ""),
                     stage["ms"] / stage["bound_ms"] if stage.get("bound_ms") else None,
                     max(0.0, stage["ms"] - stage["bound_ms"]) if "bound_ms" in stage else None)
                    for stage in sorted(row["stages"], key=lambda s: -s["ms"])],
                   folded=f"{row['id']}: {row['slices']} slices, {row['triangles']:.0f} triangles, {row['total_ms']:.0f} ms")


def results(data):
    lines = ["| input | slices a second | ms | its bounds together ms | the largest stages, ms (bound) |", "| --- | --- | --- | --- | --- |"]
    for row in data["rows"]:
        largest = sorted(row["stages"], key=lambda s: -s["ms"])[:4]
        said = ", ".join(f"{s['id']} {s['ms']:.1f}" + (f" ({s['bound_ms']:.1f})" if "bound_ms" in s else "") for s in largest)
        lines.append(f"| {row['id']} | {1e3 * row['slices'] / row['total_ms']:.0f} | {row['total_ms']:.0f} | {bound_of(row):.0f} | {said} |")
    return [*lines, "", "One thread, with a digest. The bounds: inflate, Draco and BLAKE2b alone, else the bytes read and written at the speed of memcpy."]
