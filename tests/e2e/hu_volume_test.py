# SPDX-License-Identifier: Apache-2.0
"""HU of an asset against the CT: means over the cross-section of an 11 G needle (a disc of 3.048 mm) at random positions inside the
material. The asset's are read by the reader below, written from formats/asset/asset.md alone; only the outlines come from
trocar-mesh export. Prints correlation and rms of each scan, and bytes."""
import bisect
import json
import math
import random
import struct
import zlib

import nibabel
import numpy as np

from exported import nifti, read_poly
from programs import HEAD_CT, L3_SCAN, PROGRAMS, REAL_CT, SCAN, WORK, run

RADIUS_MM = 1.524
POSITIONS = 400
SLICES = 12  # positions are in this many slices
LEAST_CORRELATION, MOST_RMS_HU = 0.985, 15


class Broken(Exception):
    pass


def require(condition, what):
    if not condition:
        raise Broken(what)


class Volume:
    """One volume of an asset's file, plane by plane."""

    def __init__(self, glb, wanted="material"):
        json_bytes, = struct.unpack("<I", glb[12:16])
        document = json.loads(glb[20:20 + json_bytes])
        ours = document["extras"]["trocar"]
        self.bits = ours["lattice_bits"]
        found = [one for one in ours["hu_volumes"] if ("margin_steps" in one) == (wanted == "material")]
        require(len(found) == 1 and found[0]["version"] == 1, "volumes")
        self.about = found[0]
        view = document["bufferViews"][self.about["bufferView"]]
        require((view["byteOffset"], view["byteLength"]) == (self.about["byteOffset"], self.about["byteLength"]), "view")
        start = 28 + json_bytes + view["byteOffset"]
        self.bytes = glb[start:start + view["byteLength"]]
        ends = [struct.unpack("<iI", self.bytes[8 * i:8 * i + 8]) for i in range(self.about["planes"])]
        starts = [8 * len(ends)] + [end for _, end in ends]
        self.places = {index: (start, end) for (index, end), start in zip(ends, starts)}
        require(starts[-1] == len(self.bytes) and sorted(self.places) == [index for index, _ in ends], "directory")
        self.x, self.y = ([round((origin + i * pitch) * 2**self.bits) for i in range(count)]
                          for origin, pitch, count in zip(self.about["origin_mm"], self.about["pitch_mm"], self.about["size"]))

    def stored(self, segments):
        """The box's columns and rows, and for each of its samples whether it is stored."""
        margin = self.about.get("margin_steps")
        if margin is None:
            return range(len(self.x)), range(len(self.y)), [[True] * len(self.x) for _ in self.y]

        def between(at, low, high):
            return range(bisect.bisect_left(at, low), bisect.bisect_right(at, high))
        columns, rows = (between(at, min(c) - margin, max(c) + margin)
                         for at, c in ((self.x, [p[0] for s in segments for p in s]), (self.y, [p[1] for s in segments for p in s])))
        stored = [[False] * len(columns) for _ in rows]
        crossings = [[] for _ in rows]
        for (ax, ay), (bx, by) in segments:
            for r in between(self.y, min(ay, by), max(ay, by) - 1):
                crossings[r - rows.start].append(ax + (self.y[r] - ay) * (bx - ax) / (by - ay))
            length2 = (bx - ax)**2 + (by - ay)**2
            for r in between(self.y, min(ay, by) - margin, max(ay, by) + margin):
                for c in between(self.x, min(ax, bx) - margin, max(ax, bx) + margin):
                    px, py = self.x[c] - ax, self.y[r] - ay
                    along = px * (bx - ax) + py * (by - ay)
                    if along <= 0:
                        near = px**2 + py**2 <= margin**2
                    elif along >= length2:
                        near = (self.x[c] - bx)**2 + (self.y[r] - by)**2 <= margin**2
                    else:
                        near = (px * (by - ay) - py * (bx - ax))**2 <= margin**2 * length2
                    if near:
                        stored[r - rows.start][c - columns.start] = True
        for row, at in zip(stored, crossings):
            at.sort()
            for low, high in zip(at[0::2], at[1::2]):
                for c in between(self.x, low, high):
                    row[c - columns.start] = True
        return columns, rows, stored

    def plane(self, index, segments):
        """HU of the stored samples: {(column, row): HU}."""
        columns, rows, stored = self.stored(segments)
        start, end = self.places[index]
        inflate = zlib.decompressobj()
        data = inflate.decompress(self.bytes[start:end]) + inflate.flush()
        require(inflate.eof and not inflate.unused_data, "stream")
        weights = struct.unpack("<6b", data[:6])
        at, width, out = 6, len(columns), {}
        before, above = [0] * (width + 4), [0] * (width + 4)
        for r, mask in zip(rows, stored):
            row = [above[2]] * 2 + [0] * (width + 2)
            for i, is_stored in enumerate(mask):
                c = i + 2
                if is_stored:
                    value = shift = 0
                    while True:
                        value |= (data[at] & 127) << shift
                        at, shift = at + 1, shift + 7
                        if data[at - 1] < 128:
                            break
                    near = (row[c - 1], above[c], above[c - 1], above[c + 1], row[c - 2], before[c])
                    residual = value // 2 if value % 2 == 0 else -(value + 1) // 2
                    row[c] = residual + (sum(w * n for w, n in zip(weights, near)) + 32) // 64
                    out[columns[i], r] = row[c] * self.about["step_hu"]
                else:
                    row[c] = (row[c - 1] + above[c]) // 2
            row[-2:] = [row[-3]] * 2
            before, above = above, row
        require(at == len(data), "numbers")
        return out

    def mean(self, plane, x_mm, y_mm):
        return mean_of(lambda c, r: plane.get((c, r)), x_mm, y_mm, self.about["origin_mm"], self.about["pitch_mm"])


def disc():
    steps = [(i + 0.5) / 12 - 1 for i in range(24)]
    return [(RADIUS_MM * a, RADIUS_MM * b) for a in steps for b in steps if a * a + b * b <= 1]


def mean_of(value, x_mm, y_mm, origin, pitch):
    """The mean over a disc, bilinear between samples; those that are None have no weight."""
    total = count = 0
    for dx, dy in disc():
        x, y = (x_mm + dx - origin[0]) / pitch[0], (y_mm + dy - origin[1]) / pitch[1]
        c, r = math.floor(x), math.floor(y)
        fx, fy, number, weights = x - c, y - r, 0, 0
        for i, wx in ((c, 1 - fx), (c + 1, fx)):
            for j, wy in ((r, 1 - fy), (r + 1, fy)):
                hu = value(i, j)
                if hu is not None and wx * wy > 0:
                    number, weights = number + wx * wy * hu, weights + wx * wy
        if weights > 0:
            total, count = total + number / weights, count + 1
    return total / count


class Nifti:
    """HU of a NIfTI volume whose axes `axes` lie in the slices and along their normal."""

    def __init__(self, file, axes=(0, 1, 2)):
        image = nibabel.load(file)
        self.values = np.transpose(image.get_fdata(), axes)
        self.count, self.pitch = self.values.shape, [image.header.get_zooms()[axis] for axis in axes[:2]]

    def at(self, i, j, k, flips):
        return self.values[tuple(n - 1 - p if flip else p for p, n, flip in zip((i, j, k), self.count, flips))]


def segments_of(folder, index, bits):
    points, ends = read_poly(folder / f"slice_{index:04d}.poly")
    places = [tuple(map(int, place)) for place in (points * 2**bits).round()]
    return [(places[a], places[b]) for a, b in ends]


def inside(segments, x, y):
    return sum(1 for (ax, ay), (bx, by) in segments if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay)) % 2 == 1


def compare(name, scan, ct, flips, *options):
    asset, folder = WORK / f"{name}.glb", WORK / name
    run(PROGRAMS / "trocar-mesh", scan, "-o", asset, "--quiet", *options)
    run(PROGRAMS / "trocar-mesh", "verify", "--private", asset)
    run(PROGRAMS / "trocar-mesh", "export", asset, "-o", folder)
    glb = asset.read_bytes()
    volume = Volume(glb)
    chance = random.Random(7)
    indices = sorted(volume.places)
    indices = sorted(chance.sample(indices, min(SLICES, len(indices))))
    got, true = [], []
    for k, index in enumerate(indices):
        segments = segments_of(folder, index, volume.bits)
        plane = volume.plane(index, segments)
        xs, ys = [p[0] for s in segments for p in s], [p[1] for s in segments for p in s]
        positions = POSITIONS * (k + 1) // len(indices) - POSITIONS * k // len(indices)
        while positions:
            x, y = chance.uniform(min(xs), max(xs)), chance.uniform(min(ys), max(ys))
            if not inside(segments, x, y):
                continue
            positions -= 1
            x_mm, y_mm = x / 2**volume.bits, y / 2**volume.bits
            got.append(volume.mean(plane, x_mm, y_mm))
            pixel = lambda i, j, k=index: ct.at(i, j, k, flips) if 0 <= i < ct.count[0] and 0 <= j < ct.count[1] else None
            true.append(mean_of(pixel, x_mm, y_mm, (0, 0), ct.pitch))
    n, a, b = len(got), sum(got) / len(got), sum(true) / len(true)
    spread = math.sqrt(sum((y - b)**2 for y in true) / n)
    correlation = sum((x - a) * (y - b) for x, y in zip(got, true)) / n / spread / math.sqrt(sum((x - a)**2 for x in got) / n)
    rms = math.sqrt(sum((x - y)**2 for x, y in zip(got, true)) / n)
    print(f"{name}: {n} discs, spread {spread:.0f} HU, correlation {correlation:.4f}, rms {rms:.1f} HU, "
          f"{volume.about['byteLength']} of {len(glb)} bytes, samples of {volume.about['pitch_mm'][0]:.3g} mm, steps of {volume.about['step_hu']} HU")
    assert correlation >= LEAST_CORRELATION and rms <= MOST_RMS_HU, name
    return volume


def test_bounds():
    sample = SCAN / "sample.nii.gz"
    ct = Nifti(sample)
    compare("sample", sample, ct, (False, False, False))
    if HEAD_CT.exists():
        compare("head", HEAD_CT, Nifti(HEAD_CT), (False, False, False))
    if L3_SCAN.exists():
        # Its axes point to the back, downwards and to the right.
        ct, flips = Nifti(L3_SCAN, (2, 0, 1)), (True, False, True)
        compare("l3", L3_SCAN, ct, flips)
        compare("l3_label", REAL_CT / "sub-ct_seg-vert_label-22_msk.nii.gz", ct, flips, "--labels", "22", "--hu", L3_SCAN)


def square(file, metal_hu):
    """A square of bone with metal in it, and air around."""
    y, x = np.mgrid[0:40, 0:48]
    hu = np.where((abs(x - 24) < 14) & (abs(y - 20) < 12), 500, -900)
    hu[18:22, 22:26] = metal_hu
    return nifti(file, np.stack([hu] * 6), (1, 1, 1.5))


def test_metal():
    """HU of metal, above what 16 bits in steps of 8 hold, are kept to the step."""
    asset = WORK / "metal.glb"
    run(PROGRAMS / "trocar-mesh", square(WORK / "metal.nii", 32000), "-o", asset, "--quiet")
    run(PROGRAMS / "trocar-mesh", "export", asset, "-o", WORK / "metal")
    volume = Volume(asset.read_bytes())
    index = sorted(volume.places)[2]
    plane = volume.plane(index, segments_of(WORK / "metal", index, volume.bits))
    most = max(plane.values())
    assert 32000 - volume.about["step_hu"] <= most <= 32000 + volume.about["step_hu"], most
    assert sum(hu > 30000 for hu in plane.values()) == 16, "pixels of metal"


def test_context():
    """--context: every sample of a coarser grid; info names it, and it is not private."""
    scan, mesh = square(WORK / "context.nii", 500), PROGRAMS / "trocar-mesh"
    for given, pitch, planes in (((), 2, 6), (("4",), 4, 3)):  # slices are 1.5 mm apart
        asset = WORK / "context.glb"
        run(mesh, scan, "-o", asset, "--quiet", "--context", *given)
        volume = Volume(asset.read_bytes(), "everything")
        assert volume.about["pitch_mm"] == [pitch, pitch] and volume.about["planes"] == planes, volume.about
        plane = volume.plane(sorted(volume.places)[-1], [])
        columns, rows = volume.about["size"]
        assert len(plane) == columns * rows == (48 // pitch) * (40 // pitch), volume.about
        # The mean of the context is that of the scan.
        true = (27 * 23 * 500 + (48 * 40 - 27 * 23) * -900) / (48 * 40)
        assert abs(sum(plane.values()) / len(plane) - true) < 4, f"{sum(plane.values()) / len(plane)}, not {true}"
        described = json.loads(run(mesh, "info", asset, "--json").stdout)["hu_volumes"]
        assert [one["covers"] for one in described] == ["material", "everything"], described
        assert "a head's can show a face" in run(mesh, "info", asset).stdout
        assert "--context" in run(mesh, "verify", "--private", asset, expect=3).stderr
        run(mesh, "verify", asset)
