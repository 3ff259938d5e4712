# SPDX-License-Identifier: Apache-2.0
"""summary_table.py OUT: the demo's tables, read from the reports and summaries in OUT."""
import csv
import json
import pathlib
import sys

PIXEL_MM2 = 0.3125**2  # of the sample scan


def table(title, head, rows):
    widths = [max(len(row[c]) for row in [head] + rows) for c in range(len(head))]
    print(f"\n{title}")
    print("  " + "  ".join(cell.ljust(w) if c == 0 else cell.rjust(w) for c, (cell, w) in enumerate(zip(head, widths))))
    print("  " + "  ".join("-" * w for w in widths))
    for row in rows:
        print("  " + "  ".join(cell.ljust(w) if c == 0 else cell.rjust(w) for c, (cell, w) in enumerate(zip(row, widths))))


def asset_row(path):
    report = json.loads(path.read_text())
    slices = [piece for piece in report["slices"] if piece["triangles"]]
    return [
        path.name.removesuffix(".report.json") + ".glb",
        f"{len(slices)}",
        f"{sum(piece['triangles'] for piece in slices)}",
        f"{min(piece['min_angle_deg'] for piece in slices):.2f}",
        f"{sum(piece['triangles_below_min_angle'] for piece in slices)}",
        f"{max(piece['max_area_mm2'] for piece in slices) / PIXEL_MM2:.1f}",
        f"{max(piece['simplification_error_mm'] for piece in slices):.3f}",
        f"{sum(piece['area_mm2'] for piece in slices):.1f}",
        f"{report['asset']['bytes']}",
        f"{report['asset']['bytes_per_triangle']:.2f}",
        f"{report['total_ms']:.0f}",
    ]


def peaks_and_depths(recording):
    """Of each puncture: the force in the last tick before it, and the penetration at it."""
    peaks, depths, before, was = [], [], 0.0, ""
    with open(recording, encoding="ascii", newline="") as stream:
        for row in csv.DictReader(stream):
            if row["state"] == "punctured" and was == "contact":
                peaks.append(before)
                depths.append(1000 * float(row["penetration_m"]))
            before, was = float(row["fz_wanted_N"]), row["state"]
    return peaks, depths


def session_row(path):
    summary = json.loads(path.read_text())
    name = path.name.removesuffix(".summary.json")
    peaks, depths = peaks_and_depths(path.with_name(f"{name}.csv"))
    faults = summary["faults"]
    return [
        name,
        f"{summary['ticks']}",
        " ".join(f"{peak:.2f}" for peak in peaks) or "-",
        " ".join(f"{depth:.3f}" for depth in depths) or "-",
        f"{summary['torque_max_Nm']:.2f}",
        f"{summary['wrench_error_max']:.0e}",
        " ".join(str(puncture["hole_vertices"]) for puncture in summary["punctures"]) or "-",
        f"{max((puncture['remesh_us'] for puncture in summary['punctures']), default=0):.0f}",
        f"{summary['tick_us']['p50']:.1f}/{summary['tick_us']['p999']:.1f}",
        f"{summary['missed_deadlines']}",
        f"{len(faults)}" if faults else "none",
    ]


def main():
    out = pathlib.Path(sys.argv[1])
    table("Assets (each passed trocar-mesh verify)",
          ["asset", "slices", "triangles", "min angle deg", "below it", "max px^2", "simplified mm",
           "area mm^2", "bytes", "bytes/tri", "ms"],
          [asset_row(out / f"{name}.report.json") for name in ("sample", "sample_nifti", "paper")])
    sessions = sorted((out / "recordings").glob("*.summary.json"))
    table("Sessions (K 5 kN/m, threshold 35 N: 7 mm; *_subpixel on sample.glb, the others on paper.glb; *_real against the wall clock, the others virtual)",
          ["session", "ticks", "peaks N", "punctured at mm", "max Nm", "wrench error", "hole vertices",
           "remesh us", "tick us p50/p99.9", "missed", "faults"],
          [session_row(path) for path in sessions])
    pictures = sorted(path.name for path in (out / "pictures").glob("*.png"))
    print(f"\n{len(pictures)} pictures in {out / 'pictures'} (index.html); recordings in {out / 'recordings'}")
    print("Look at an asset: any glTF viewer with Draco, for example https://gltf-viewer.donmccurdy.com")


if __name__ == "__main__":
    main()
