# SPDX-License-Identifier: Apache-2.0
"""What a session renders in L3 against the CT itself: the strength along random vertical paths, and the force through the pedicles.

At each slice that the cutting front passes, the recording's `tip_N` is the rendered strength. The other strength is computed here: the
bone law of T. Kopperdahl and T. Keaveny (1998) for the mean HU of the CT, bilinear between its voxels, over that part of the tool's
cross-section which lies over bone, plus the tearing at the tool's outline, both times that part.

Through a pedicle from behind, the force must have a peak in the cortex, a plateau in the cancellous bone and a drop where the tip leaves
the vertebra in front.

Without the real CT the tests are skipped.
"""
import csv
import json
import math
import random

import nibabel
import numpy as np
import pytest
from programs import L3_SCAN, PROGRAMS, WORK, run


PATHS = 30
LEAST_CORRELATION = 0.97
THRESHOLD_HU = 226
RADIUS_M, SIDES = 1.5e-3, 12
TEARING_N_PER_M = 500
DENSITY_PER_HU = 8e-4  # g/cm^3
MARGIN_M, SPEED_M_PER_S = 4e-3, 0.02
# The tool passes less than this in a tick, unless it jumps over a gap.
MAX_STEP_M = 4e-4


def strength_N(hu, part):
    """The force on a flat tip, of whose cross-section `part` lies over bone of this mean HU."""
    pressure_Pa = 1e6 * max(0.16, 37.4 * max(DENSITY_PER_HU * hu, 0.0)**1.39)
    area_m2 = SIDES / 2 * RADIUS_M**2 * math.sin(2 * math.pi / SIDES)
    outline_m = 2 * SIDES * RADIUS_M * math.sin(math.pi / SIDES)
    return part * (pressure_Pa * area_m2 + TEARING_N_PER_M * outline_m)


class Ct:
    """The planes of L3, whose axes point to the back, downwards and to the right, in the coordinates of its asset."""

    def __init__(self):
        volume = nibabel.load(L3_SCAN)
        self.planes = np.flip(np.asarray(volume.dataobj, float), (1, 2)).transpose(1, 0, 2)
        self.pitch_mm = float(volume.header.get_zooms()[0])
        steps = (np.arange(60) + 0.5) / 30 - 1
        x, y = np.meshgrid(steps, steps)
        edge = math.cos(math.pi / SIDES)
        inside = np.ones(x.shape, bool)
        for k in range(SIDES):
            angle = 2 * math.pi * (k + 0.5) / SIDES
            inside &= x * math.cos(angle) + y * math.sin(angle) <= edge
        self.section_mm = 1e3 * RADIUS_M * np.stack([x[inside], y[inside]])

    def under(self, k, at_mm):
        """Mean HU of the bone under the tool in the k-th slice, and the part of the cross-section over bone."""
        column, row = (self.section_mm + np.array(at_mm)[:, None]) / self.pitch_mm
        c, r = np.floor(column).astype(int), np.floor(row).astype(int)
        fx, fy, plane = column - c, row - r, self.planes[k]
        hu = ((1 - fy) * ((1 - fx) * plane[r, c] + fx * plane[r, c + 1])
              + fy * ((1 - fx) * plane[r + 1, c] + fx * plane[r + 1, c + 1]))
        bone = hu >= THRESHOLD_HU
        return (hu[bone].mean() if bone.any() else 0.0), bone.mean()


def session(name, asset, at_mm, count, spacing_m, **tissue):
    """The recording's rows of a session straight down through the first `count` slices, and the height of the highest one."""
    height_m = (count - 1) * spacing_m
    top_m = 0.148 + height_m / 2
    down_s = (height_m + 2 * MARGIN_M) / SPEED_M_PER_S
    scene = {
        "schema": "trocar.scene/1", "name": name, "asset": asset, "duration_s": 0.2 + down_s,
        "placement": {"anchor_mm": at_mm}, "body": {"from": 0, "to": count - 1, "top_z_m": top_m},
        "tissue": {"cut": {"bone": {"law": "kopperdahl-power", "g_per_cm3_per_HU": DENSITY_PER_HU}, "tearing_N_per_m": TEARING_N_PER_M,
                           "friction_kPa": 0, "bed_N_per_mm3": 300, "lateral_strength_MPa": 100, **tissue}},
        "force_law": {"kind": "cutting", "force_scale": 0.1},
        "tool": {"sides": SIDES, "radius_m": RADIUS_M},
        "hand": {"stiffness_N_per_m": 8000, "damping_N_s_per_m": 140,
                 "trajectory": [{"t_s": 0, "tip_m": [0, 0, top_m + MARGIN_M]}, {"t_s": 0.2, "tip_m": [0, 0, top_m + MARGIN_M]},
                                {"t_s": 0.2 + down_s, "tip_m": [0, 0, top_m - height_m - MARGIN_M]}]}}
    file, recording = WORK / f"{name}.json", WORK / f"{name}.csv"
    file.write_text(json.dumps(scene))
    run(PROGRAMS / "trocar-run", file, "--clock", "virtual", "--quiet", "--record", recording)
    with recording.open() as lines:
        rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    recording.unlink()
    return rows, top_m


def passed(rows, z_m):
    """The force on the tip when the front passes this height; None if it does not, or jumps over it."""
    for before, now in zip(rows, rows[1:]):
        high, low = float(before["front_z_m"]), float(now["front_z_m"])
        if high > z_m >= low > 0 and float(before["tip_N"]) > 0:
            return float(now["tip_N"]) if high - low < MAX_STEP_M and float(now["tip_N"]) > 0 else None
    return None


with_l3 = pytest.mark.skipif(not L3_SCAN.exists(), reason="the real CT of L3 is not here")


@with_l3
def test_strength():
    run(PROGRAMS / "trocar-mesh", L3_SCAN, "-o", WORK / "l3.glb", "--quiet")
    ct, chance = Ct(), random.Random(34)
    count = len(ct.planes)
    spacing_m = ct.pitch_mm / 1e3
    rows_count, columns_count = ct.planes[0].shape
    rendered, computed, whole = [], [], []
    for path in range(PATHS):
        while True:
            at_mm = [chance.uniform(4, (columns_count - 5) * ct.pitch_mm), chance.uniform(4, (rows_count - 5) * ct.pitch_mm)]
            parts = [ct.under(k, at_mm)[1] for k in range(count)]
            if sum(part > 0.5 for part in parts) >= 4:
                break
        rows, top_m = session(f"path_{path}", "l3.glb", at_mm, count, spacing_m)
        for k in range(count):
            hu, part = ct.under(k, at_mm)
            force_N = passed(rows, top_m - (count - 1 - k) * spacing_m)
            if part > 0 and force_N is not None:
                rendered.append(force_N)
                computed.append(strength_N(hu, part))
                whole.append(part == 1)
    rendered, computed, whole = np.array(rendered), np.array(computed), np.array(whole)
    correlation = float(np.corrcoef(rendered, computed)[0, 1])
    ratio = rendered[whole] / computed[whole]
    print(f"{len(rendered)} places, {whole.sum()} of them fully over bone; strength {computed.min():.1f} to {computed.max():.1f} N; "
          f"correlation {correlation:.4f}, fully over bone {np.corrcoef(rendered[whole], computed[whole])[0, 1]:.4f}, "
          f"there rendered / computed {np.median(ratio):.3f} in the median")
    assert len(rendered) >= 200 and whole.sum() >= 20
    assert correlation >= LEAST_CORRELATION
    assert 0.95 <= np.median(ratio) <= 1.05


# Voxels (down, to the right) of the middles of the pedicles where these are thinnest, and the slices in which both paths are in
# the cancellous bone of the vertebral body. All are from the labels of sub-regions beside the scan.
PEDICLES = {"right": (17, 24), "left": (17.5, 48.2)}
CANCELLOUS = range(18, 27)
CORONAL_SLICES = 61  # from the front to behind the pedicles


@with_l3
def test_pedicles():
    run(PROGRAMS / "trocar-mesh", L3_SCAN, "--axis", "coronal", "--preset", "vertebra", "-o", WORK / "coronal.glb", "--quiet")
    volume = nibabel.load(L3_SCAN)
    pitch_mm, across = float(volume.header.get_zooms()[0]), volume.shape[2]
    for side, (down, right) in PEDICLES.items():
        at_mm = [pitch_mm * (across - 1 - right), pitch_mm * down]
        rows, top_m = session(f"{side}_pedicle", "coronal.glb", at_mm, CORONAL_SLICES, pitch_mm / 1e3, friction_kPa=60,
                              bed_N_per_mm3=30, lateral_strength_MPa=5)
        voxel = CORONAL_SLICES - 1 - 1e3 * (top_m - np.array([float(row["tool_z_m"]) for row in rows])) / pitch_mm
        tip_N = np.array([float(row["tip_N"]) for row in rows])
        whole_N = np.array([float(row["fz_tissue_N"]) for row in rows])
        inside = (voxel > CANCELLOUS.start) & (voxel < CANCELLOUS.stop)
        plateau_N, peak_N = np.median(tip_N[inside]), tip_N[voxel > CANCELLOUS.stop].max()
        front_N = tip_N[voxel < CANCELLOUS.start].max()
        print(f"{side} pedicle: peak {peak_N:.1f} N, plateau {plateau_N:.1f} N (at least {tip_N[inside].min():.1f} N), "
              f"cortex in front {front_N:.1f} N, at the end {tip_N[-1]:.1f} N at the tip and {whole_N[-1]:.1f} N with the shaft")
        assert peak_N > 3 * plateau_N and tip_N[inside].min() > 2, "a peak, then a plateau without a gap"
        assert front_N > 1.5 * plateau_N and tip_N[-1] == 0, "the breach"
        assert 10 < whole_N[-1] < whole_N.max() / 2, "the shaft's friction stays"
