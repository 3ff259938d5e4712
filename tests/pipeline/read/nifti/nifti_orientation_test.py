# SPDX-License-Identifier: Apache-2.0
"""A shape without symmetry, stored by nibabel in all 48
orders and directions of array axes, must be at the same position in the patient."""
import itertools
import json
import subprocess

import nibabel
import numpy as np


def test_nifti_orientation(programs, work):
    mesh = programs / "trocar-mesh"
    # Boxes of different sizes in a corner of a volume indexed by x, y, z of RAS, mm voxels 1, 1.5, 2.
    volume = np.zeros((24, 20, 6), np.int16)
    volume[3:11, 4:10, 1:4] = 500
    volume[14:16, 12:18, 3] = 500
    sizes = np.array([1.0, 1.5, 2.0])
    origin = np.array([-7.0, 11.0, 5.0])
    expected = None
    for order in itertools.permutations(range(3)):
        for flips in itertools.product((False, True), repeat=3):
            affine = np.zeros((4, 4))
            affine[3, 3] = 1
            affine[:3, 3] = origin
            data = volume.transpose(order)
            for axis, (source, flip) in enumerate(zip(order, flips)):
                affine[source, axis] = -sizes[source] if flip else sizes[source]
                if flip:
                    affine[source, 3] += sizes[source] * (volume.shape[source] - 1)
                    data = np.flip(data, axis)
            file, asset = work / "turned.nii", work / "turned.glb"
            nibabel.save(nibabel.Nifti1Image(np.ascontiguousarray(data), affine), file)
            subprocess.run([mesh, file, "-o", asset, "--quiet", "--tolerance", "0", "--threshold", "250"], check=True)
            subprocess.run([mesh, "export", asset, "-o", work / "export"], check=True)
            info = json.loads(subprocess.run([mesh, "info", asset, "--json"], check=True, stdout=subprocess.PIPE).stdout)
            points = []
            for obj in sorted((work / "export").glob("*.obj")):
                rows = [line.split()[1:4] for line in obj.read_text().splitlines() if line.startswith("v ")]
                points.append(sorted(map(tuple, np.array(rows, float).round(3).tolist())))
            seen = ([round(s["area_mm2"], 3) for s in info["slices"]], points)
            if expected is None:
                # The first is the identity: its vertices must lie half a voxel around the boxes, in LPS (except for
                # the few hundredths by which contours move out beside a corner, to restore the area that its chord cuts off).
                low, high = np.array(points[0]).min(0), np.array(points[0]).max(0)
                right, left = origin[0] + 2.5, origin[0] + 10.5
                front, back = origin[1] + 1.5 * 9.5, origin[1] + 1.5 * 3.5
                want = [-left, -front, origin[2] + 2, -right, -back, origin[2] + 2]
                assert np.allclose([*low, *high], want, atol=0.03), f"the identity lies at {low} {high}, not {want}"
                expected = seen
            else:
                assert seen == expected, f"order {order}, flips {flips}: another position"
