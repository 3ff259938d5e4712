# SPDX-License-Identifier: Apache-2.0
"""path_ratios.py BIN SCAN [REPETITIONS]: from the sample's PNG and DICOM files (SCAN/png, SCAN/dicom) to a verified asset,
over OpenCV's decoding of the same PNGs, and two threads over one: medians of one run of BIN/pipeline_sweep.

The bounds are for wall-clock time on an idle machine; on a busy one, use CPU time. The ratio of two threads to one is
meaningful only if a second core was idle."""
import json
import os
import pathlib
import subprocess
import sys


def main():
    programs, scan = map(pathlib.Path, sys.argv[1:3])
    geometry = json.loads((scan / "sample.json").read_text())
    low, high = geometry["png_window_HU"]
    plan = {"repetitions": int(sys.argv[3]) if len(sys.argv) > 3 else 15, "scans": [], "points": [],
            "path": {"png": str(scan / "png"), "dicom": str(scan / "dicom"), "spacing_mm": geometry["spacing_mm"],
                     "grey_threshold": (226 - low) / (high - low) * 255}}
    done = subprocess.run([programs / "pipeline_sweep"], input=json.dumps(plan), text=True, stdout=subprocess.PIPE, check=True)
    path = json.loads(done.stdout)["path"]
    print(f"{path['slices']} slices; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(f"{'':28}{'wall ms':>10}{'CPU ms':>10}")
    for name in ("opencv_png_decode", "png_to_glb_1_thread", "png_to_glb_2_threads", "dicom_to_glb_1_thread",
                 "dicom_to_glb_2_threads", "verify"):
        print(f"{name:28}{path[name + '_ms']:10.1f}{path[name + '_cpu_ms']:10.1f}")
    for kind in ("png", "dicom"):
        one, two = f"{kind}_to_glb_1_thread", f"{kind}_to_glb_2_threads"
        over = {unit: (path[one + unit] + path["verify" + unit]) / path["opencv_png_decode" + unit] for unit in ("_ms", "_cpu_ms")}
        print(f"{kind}, one thread, verified, over OpenCV's decoding: {over['_ms']:.2f} (CPU {over['_cpu_ms']:.2f}), at most 1.25")
        print(f"{kind}, two threads over one: {path[one + '_ms'] / path[two + '_ms']:.2f}, at least 1.8")


if __name__ == "__main__":
    main()
