# SPDX-License-Identifier: Apache-2.0
"""A NIfTI whose sform disagrees with pixdim by more than 1 %, or shears, is warned of with the
voxel's and the material's volume by both. nibabel writes the files; the header is patched afterwards."""
import math
import struct

import nibabel
import numpy as np
from mesh_runs import MeshRuns

N, BLOCK = (40, 32, 12), (slice(8, 30), slice(6, 26), slice(2, 9))
BONE, AIR = 500, -200  # half-way is above the skin: no warning of a face
VOXELS = 22 * 20 * 7


def volume(file, columns, pixdim, codes=(1, 0), kind=nibabel.Nifti1Image):
    """A block of bone; the columns of its affine and its pixdim are given apart. `codes` are those of sform and qform."""
    data = np.full(N, AIR, np.int16)
    data[BLOCK] = BONE
    affine = np.eye(4)
    affine[:3, :3] = np.array(columns, float).T
    nibabel.save(kind(data, affine), file)
    raw = bytearray(file.read_bytes())
    if kind is nibabel.Nifti1Image:
        struct.pack_into("<3f", raw, 80, *pixdim)
        struct.pack_into("<2h", raw, 252, codes[1], codes[0])
    else:
        struct.pack_into("<3d", raw, 112, *pixdim)
        struct.pack_into("<2i", raw, 344, codes[1], codes[0])
    file.write_bytes(raw)
    return file


def codes(report):
    return [w["code"] for w in report["warnings"]]


class DryRun(MeshRuns):
    def run(self, file, *words):
        code, lines, report, *_ = super().run(file, "--threshold", (AIR + BONE) / 2, *words)
        return code, "\n".join(lines), report

    def agrees(self, name, columns, pixdim, **keys):
        code, said, report = self.run(volume(self.work / f"{name}.nii", columns, pixdim, **keys))
        assert code == 0 and codes(report) == ["empty_slice"], f"{name}: exit {code}, {said!r}"

    def differs(self, name, columns, pixdim, *texts, words=(), **keys):
        """Warned, with both volumes; the sform's are those of the meshes. Returns what the warning says of the volumes."""
        code, said, report = self.run(volume(self.work / f"{name}.nii", columns, pixdim, **keys), *words)
        found = [w for w in report["warnings"] if w["code"] == "voxel_volume"]
        assert code == 0 and codes(report) == ["voxel_volume", "empty_slice"], f"{name}: exit {code}, {said!r}"
        w = found[0]
        assert w["where"].endswith(f"{name}.nii") and all(text in w["sentence"] for text in ("the sform is used", *texts)), f"{name}: {w}"
        assert "warning (voxel_volume)" in said and len(said.splitlines()) == 2, f"{name}: {said!r}"
        by_sform = abs(np.linalg.det(np.array(columns, float)))
        by_pixdim = math.prod(p if p else np.linalg.norm(c) for p, c in zip(pixdim, columns))
        assert np.allclose([w["voxel_mm3"]["sform"], w["voxel_mm3"]["pixdim"]], [by_sform, by_pixdim], rtol=1e-5), f"{name}: {w['voxel_mm3']}, not {by_sform}, {by_pixdim}"
        material = w["material_mm3"]
        assert abs(material["sform"] / (VOXELS * by_sform) - 1) < 0.02, f"{name}: material {material['sform']}, not {VOXELS * by_sform}"
        assert abs(material["pixdim"] / material["sform"] / (by_pixdim / by_sform) - 1) < 1e-5, f"{name}: {material}"
        for number in (*w["voxel_mm3"].values(), *material.values()):
            assert f"{number:.4g} " in w["sentence"] + " ", f"{name}: {number:.4g} is not in {w['sentence']!r}"
        # What the meshes have: the sum of areas times the distance between the planes.
        slices = report["slices"]
        step = slices[1]["z_mm"] - slices[0]["z_mm"]
        assert abs(sum(s["area_mm2"] for s in slices) * step / material["sform"] - 1) < 1e-5, f"{name}: {material} and the slices' areas"
        return w


def test_voxel_volume(programs, work):
    t = DryRun(programs, work)
    x, y, z = (-0.75, 0, 0), (0, -0.75, 0), (0, 0, 2)
    size = (0.75, 0.75, 2)
    # Nothing to say: equal, exactly 1 %, rotated, no sform (pixdim is used), no pixdim, no pixdim along one axis.
    t.agrees("equal", (x, y, z), size)
    t.agrees("equal_2", (x, y, z), size, kind=nibabel.Nifti2Image)
    t.agrees("one_percent", (x, y, (0, 0, 2.02)), size)
    t.agrees("minus_one_percent", (x, y, (0, 0, 1.98)), size)
    c, s = math.cos(0.3), math.sin(0.3)
    t.agrees("rotated", (x, (0, -0.75 * c, 0.75 * s), (0, 2 * s, 2 * c)), size)
    t.agrees("no_sform", (x, y, (0, 0, 5)), size, codes=(0, 1))
    t.agrees("no_pixdim", (x, y, z), (0, 0, 0))
    t.agrees("no_pixdim_along_z", (x, y, z), (0.75, 0.75, math.nan))
    t.agrees("negative_pixdim", (x, y, z), (-0.75, 0.75, 2))
    # Without sform and qform a pixdim is a length, whatever its sign: the same file with another sign is the same asset.
    made = []
    for sign in (1, -1):
        code, said, report = t.run(volume(t.work / "no_forms.nii", (x, y, z), (sign * 0.75, sign * 0.75, sign * 2), codes=(0, 0)))
        assert code == 0 and "no_orientation" in codes(report), f"no forms, sign {sign}: exit {code}, {said!r}"
        made.append((t.work / "out.glb").read_bytes())
    assert made[0] == made[1], "a negative pixdim without sform and qform turns the scan"
    # Spacings that differ, along each axis.
    for axis in range(3):
        columns = [np.array(v) for v in (x, y, z)]
        columns[axis] = columns[axis] * 1.011
        t.differs(f"spacing_{axis}", columns, size, "0.75 x 0.75 x 2 mm")
    t.differs("half", (x, y, (0, 0, 1)), size, "0.75 x 0.75 x 1 mm", kind=nibabel.Nifti2Image)
    t.differs("along_an_axis", (x, y, (0, 0, 1)), size, words=("--axis", "coronal"))
    # A shear: a tilted gantry that a converter did not correct. Here a voxel's volume is 23 % less than pixdim says.
    tilt = math.acos(0.77)
    w = t.differs("tilt", (x, y, (0, 2 * math.sin(tilt), 2 * math.cos(tilt))), size, "shears by 39.65 degrees")
    assert w and abs(w["material_mm3"]["sform"] / w["material_mm3"]["pixdim"] - 0.77) < 1e-3, f"-23 %: {w}"
    t.differs("tilt_of_1_degree", (x, y, (0, 2 * math.sin(math.radians(1)), 2 * math.cos(math.radians(1)))), size, "shears by 1 degrees")
    t.differs("tilt_without_pixdim", (x, y, (0, 1, 2)), (0, 0, 0), "shears by 26.57 degrees")
    t.differs("tilt_and_spacing", (x, y, (0, 2 * math.tan(0.3), 2)), size, "shears", "0.75 x 0.75 x 2.094 mm")
    # Sheared within the slices: nothing is resampled, so this cannot be meshed; the reason and a way out are given.
    sheared = volume(t.work / "in_plane.nii", (x, (0.3, -0.75, 0), z), size)
    code, said, report = t.run(sheared)
    assert code == 3 and report is None and "in_plane.nii: " in said and "shears by 21.8 degrees" in said and "--axis" in said, f"in plane: {code} {said!r}"
