# SPDX-License-Identifier: Apache-2.0
"""X-ray pictures and planes of the CT, as the console's page computes them, against the voxels of the scan.

 1. Ray sums of an asset against ray sums of the scan's voxels inside the asset's outlines, with the same function: AP, lateral, oblique.
 2. With the context volume, against ray sums of the whole scan: the detail, which is the picture without what changes slowly.
 3. The needle's shadow ends within a pixel of its tip's projection.
 4. HU at the centres of voxels, the directions of the planes, and grey levels of a window.
 5. What has no X-ray says why.

The geometry of the C-arm, the sums and the planes are computed here again, from the scan's own file. The page's code runs in node.
"""
import json
import math
import subprocess

import numpy as np
import pytest
import scipy.ndimage

from console_client import Console
from hu_volume_test import Volume, segments_of
from programs import HEAD_CT, L3_SCAN, PROGRAMS, SCAN, SOURCE, WORK, run

nibabel, pydicom = pytest.importorskip("nibabel"), pytest.importorskip("pydicom")

VIEWS = {"AP": (0, 0), "lateral": (90, 0), "oblique": (25, -15)}
SOURCE_TO_MIDDLE_MM, SIZE = 600.0, 160
LEAST_CORRELATION, LEAST_DETAIL, SOFT_TISSUE_HU = 0.985, 0.96, 40


class Case:
    """A scan, its asset and a scene with all slices. `axes`: the scan's axes along a slice's rows and columns, and along its normal;
    `flips`: which of them count backwards.
    The scene is that of `scene_of` if an asset of that name has one already."""
    proposed = {}

    def __init__(self, name, scan, axes=(0, 1, 2), flips=(False, False, False), options=(), width_mm=110, scene_of=None):
        self.name, self.width_mm = name, width_mm
        self.asset = WORK / f"{name}.glb"
        run(PROGRAMS / "trocar-mesh", scan, "-o", self.asset, "--quiet", *options)
        run(PROGRAMS / "trocar-mesh", "export", self.asset, "-o", WORK / name)
        if scene_of in Case.proposed:
            (WORK / f"{name}.json").write_text(json.dumps({**Case.proposed[scene_of], "asset": self.asset.name}))
        else:
            run(PROGRAMS / "trocar-run", "new-scene", self.asset, "-o", WORK / f"{name}.json")
        Case.proposed[name] = scene = json.loads((WORK / f"{name}.json").read_text())
        image = nibabel.load(scan)
        hu = np.transpose(np.asanyarray(image.dataobj).astype(np.float32), axes)
        self.hu = hu[tuple(slice(None, None, -1 if flip else 1) for flip in flips)]
        to_lps = np.diag([-1, -1, 1]) @ image.affine[:3, :3]
        columns = [to_lps[:, a] * (-1 if flip else 1) for a, flip in zip(axes, flips)]
        self.pitch = np.array([np.linalg.norm(c) for c in columns])
        self.axes = np.array([c / np.linalg.norm(c) for c in columns]).T  # of {B}, in LPS
        anchor, top = scene["placement"]["anchor_mm"], scene["body"]["to"]
        # A voxel (i, j, k) lies in {B}, mm, at pitch * (i, j, k) + origin.
        self.origin = np.array([-anchor[0], -anchor[1], scene["body"]["top_z_m"] * 1000 - top * self.pitch[2]])
        self.bits = json.loads((self.asset.read_bytes()[20:20 + int.from_bytes(self.asset.read_bytes()[12:16], "little")]))["extras"]["trocar"]["lattice_bits"]

    def inside(self):
        """True for the voxels whose centre lies in the outlines of its slice."""
        mask = np.zeros(self.hu.shape, bool)
        for k in range(mask.shape[2]):
            file = WORK / self.name / f"slice_{k:04d}.poly"
            if not file.exists():
                continue
            a, b = (np.array(ends, float) / 2**self.bits / self.pitch[:2] for ends in zip(*segments_of(WORK / self.name, k, self.bits)))
            for j in range(mask.shape[1]):
                crosses = (a[:, 1] > j) != (b[:, 1] > j)
                at = np.sort(a[crosses, 0] + (j - a[crosses, 1]) / (b[crosses, 1] - a[crosses, 1]) * (b[crosses, 0] - a[crosses, 0]))
                for low, high in zip(at[0::2], at[1::2]):
                    mask[math.ceil(low):math.floor(high) + 1, j, k] = True
        return mask

    def c_arm(self, turn_deg, tilt_deg):
        """The directions in {B} of the middle ray, and to the right and upwards on the picture."""
        a, b = math.radians(turn_deg), math.radians(tilt_deg)
        to_device = self.axes.T
        ray = to_device @ [math.cos(b) * math.sin(a), math.cos(b) * math.cos(a), math.sin(b)]
        right = to_device @ [math.cos(a), -math.sin(a), 0]
        up = to_device @ np.cross([math.cos(a), -math.sin(a), 0], [math.cos(b) * math.sin(a), math.cos(b) * math.cos(a), math.sin(b)])
        return ray, right, up

    def project(self, place_mm, middle_mm, turn_deg, tilt_deg):
        """Column and row of the pixel that shows a position."""
        ray, right, up = self.c_arm(turn_deg, tilt_deg)
        from_source = place_mm - (middle_mm - SOURCE_TO_MIDDLE_MM * ray)
        scale = SOURCE_TO_MIDDLE_MM / (from_source @ ray) / self.width_mm * SIZE
        return [SIZE / 2 - 0.5 + scale * (from_source @ right), SIZE / 2 - 0.5 - scale * (from_source @ up)]

    def ray_sum(self, values, middle_mm, turn_deg, tilt_deg):
        """The integral of trilinear values / 1000 along the rays of the C-arm, in mm."""
        ray, right, up = self.c_arm(turn_deg, tilt_deg)
        at = ((np.arange(SIZE) + 0.5) / SIZE - 0.5) * self.width_mm
        rays = SOURCE_TO_MIDDLE_MM * ray + at[None, :, None] * right - at[:, None, None] * up
        rays /= np.linalg.norm(rays, axis=2, keepdims=True)
        source, step = middle_mm - SOURCE_TO_MIDDLE_MM * ray, 0.7 * self.pitch.min()
        # Only the box that has values, with zeros around it.
        boxes = [np.flatnonzero(values.any(axis=tuple(k for k in range(3) if k != axis))) for axis in range(3)]
        first = np.array([box[0] for box in boxes])
        padded = np.pad(values[tuple(slice(box[0], box[-1] + 1) for box in boxes)], 1)
        corner = self.origin + self.pitch * (first - 1)
        ends = corner + np.array(list(np.ndindex(2, 2, 2))) * self.pitch * (np.array(padded.shape) - 1)
        depths = (ends - source) @ ray
        start, along = (source - corner) / self.pitch, rays.reshape(-1, 3) / self.pitch
        # Of each ray the part in the box.
        with np.errstate(divide="ignore"):
            sides = np.sort([(-start) / along, (np.array(padded.shape) - 1 - start) / along], axis=0)
        enters, leaves = sides[0].max(axis=1), sides[1].min(axis=1)
        total, depths = np.zeros(len(along)), np.arange(depths.min(), 1.05 * depths.max(), step)
        for t in depths:
            passes = (enters <= t) & (t <= leaves)
            total[passes] += scipy.ndimage.map_coordinates(padded, (start + t * along[passes]).T, order=1)
        return total.reshape(SIZE, SIZE) * step / 1000


def correlation(a, b):
    return float(np.corrcoef(np.ravel(a), np.ravel(b))[0, 1])


def detail(picture, blur=True):
    """The picture less its blur, or as it is, without its edges."""
    width, wide = 12 * SIZE // 256 | 1, picture if blur else 0
    for axis in (0, 1, 0, 1) if blur else ():
        wide = np.apply_along_axis(lambda line: np.convolve(np.pad(line, width // 2, "edge"), np.ones(width) / width, "valid"), axis, wide)
    edge = SIZE // 8
    return (picture - wide)[edge:-edge, edge:-edge]


@pytest.fixture(name="console", scope="module")
def started_console():
    WORK.mkdir(parents=True, exist_ok=True)
    console = Console(PROGRAMS / "trocar-console", WORK, page=SOURCE / "runtime/console/page")
    yield console
    console.stop()


def volume_of(console, name):
    """The answer of the console as bytes, and its JSON."""
    status, answer = console.get(f"/api/volume?scene={name}.json")
    assert status == 200, answer
    return answer, json.loads(answer[4:4 + int.from_bytes(answer[:4], "little")])


def page_computes(answer, **job):
    (WORK / "volume.bin").write_bytes(answer)
    (WORK / "job.json").write_text(json.dumps(job))
    done = subprocess.run(["node", SOURCE / "tests/e2e/console/imaging.mjs", WORK / "volume.bin", WORK / "job.json"],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def page_sums(answer, width_mm, **job):
    sums = [{"turn_deg": turn, "tilt_deg": tilt, "width_m": width_mm / 1000, "size": SIZE, "file": str(WORK / f"{name}.f32")}
            for name, (turn, tilt) in VIEWS.items()]
    out = page_computes(answer, sums=sums, **job)
    return {name: np.fromfile(WORK / f"{name}.f32", np.float32).reshape(SIZE, SIZE) for name in VIEWS}, out


CASES = {"sample": ((SCAN / "sample.nii.gz",), {}),
         "l3": ((L3_SCAN, (2, 0, 1), (True, False, True), ("--preset", "vertebra")), {}),
         "head": ((HEAD_CT,), {"width_mm": 260})}


@pytest.mark.parametrize("name", CASES)
def test_bone_alone(console, name):
    arguments, keys = CASES[name]
    if not arguments[0].is_file():
        pytest.skip(f"no scan {arguments[0]}")
    case = Case(name, *arguments, **keys)
    answer, about = volume_of(console, name)
    assert np.allclose([about["patient"][key] for key in ("left", "back", "head")], case.axes, atol=1e-5), about["patient"]
    excess = np.where(case.inside(), np.maximum(0, case.hu - SOFT_TISSUE_HU), 0)
    pictures, out = page_sums(answer, case.width_mm)
    for (view, angles), ms in zip(VIEWS.items(), out["ms"]):
        true = case.ray_sum(excess, np.array(about["middle_m"]) * 1000, *angles)
        r = correlation(pictures[view], true)
        rms = math.sqrt(np.mean((pictures[view] - true)**2))
        print(f"{name}, {view}: r {r:.4f}, rms {rms:.2f} of at most {true.max():.1f} mm of water, {ms:.0f} ms for {SIZE} x {SIZE}")
        assert r >= LEAST_CORRELATION, (name, view)


@pytest.mark.parametrize("name, context_mm", [("sample", 2), ("l3", 2)])
def test_context(console, name, context_mm):
    arguments, keys = CASES[name]
    if not arguments[0].is_file():
        pytest.skip(f"no scan {arguments[0]}")
    padded = list(arguments) + [(0, 1, 2), (False, False, False), ()][len(arguments) - 1:]
    padded[3] = (*padded[3], "--context", str(context_mm))
    case = Case(f"{name}_context", *padded, **keys, scene_of=name)
    answer, about = volume_of(console, f"{name}_context")
    assert about["context"]["planes"], about
    pictures, _ = page_sums(answer, case.width_mm)
    middle_mm = np.array(about["middle_m"]) * 1000
    # The scan's first and last slices are edges that no patient has, and its detail there is that of the edge.
    ends = np.zeros(case.hu.shape, np.float32)
    thick = math.ceil(12 * case.width_mm / 256 / case.pitch[2])
    ends[:, :, :thick] = ends[:, :, -thick:] = 1
    for view, angles in VIEWS.items():
        true = case.ray_sum(np.maximum(0, 1000 + case.hu), middle_mm, *angles)
        good = detail(case.ray_sum(ends, middle_mm, *angles), blur=False) == 0
        if good.mean() < 0.1:  # oblique rays through a short stack all pass its ends
            good[:] = True
        r = correlation(detail(pictures[view])[good], detail(true)[good])
        print(f"{name} with its context, {view}: detail r {r:.4f}, whole r {correlation(pictures[view], true):.4f}")
        assert r >= LEAST_DETAIL, (name, view)


@pytest.fixture(name="sample", scope="module")
def sample_case(console):
    case = Case("planes", SCAN / "sample.nii.gz", scene_of="sample")
    return (case, *volume_of(console, "planes"))


def test_needle_ends_at_its_tip(sample):
    """The shadow ends within a pixel of the tip's projection. The needle is one pixel wide, so that its own width does not count."""
    case, answer, about = sample
    radius_m, middle_mm = 0.52 * case.width_mm / SIZE / 1000, np.array(about["middle_m"]) * 1000
    place_mm = middle_mm + (5, -7, 4)
    for axis in ((0, 0, 1), (0.3, 0.5, 0.81240384)):
        _, out = page_sums(answer, case.width_mm, tip=(place_mm / 1000).tolist(), axis=axis, radius_m=radius_m)
        for (view, angles), changed, (tip, up) in zip(VIEWS.items(), out["needles"], out["projected"]):
            assert np.allclose(tip, case.project(place_mm, middle_mm, *angles), atol=1e-6), (view, tip)
            along, changed = np.subtract(up, tip), np.array(changed)
            if np.linalg.norm(along) < 5:  # seen along its axis
                assert np.linalg.norm(changed - tip, axis=1).min() <= 1, (view, axis)
                continue
            along /= np.linalg.norm(along)
            way, aside = (changed - tip) @ along, (changed - tip) @ (-along[1], along[0])
            end = changed[np.argmin(way)]
            print(f"{view}: the shadow ends {np.linalg.norm(end - tip):.2f} pixels from the tip, and is {np.abs(aside).max():.2f} off its line at most")
            assert np.linalg.norm(end - tip) <= 1, (view, axis, end, tip)
            assert np.abs(aside).max() <= 1, (view, axis)


def test_planes_have_the_hu_of_the_asset(sample):
    """At each sample that the asset stores, and in no other, the page has its HU. The reader of the asset was written from asset.md."""
    case, answer, about = sample
    volume, places, stored = Volume(case.asset.read_bytes()), [], []
    for plane in about["bone"]["planes"][::5]:
        hu = volume.plane(plane["slice"], segments_of(WORK / case.name, plane["slice"], case.bits))
        (first_x, first_y), pitch = volume.about["origin_mm"], volume.about["pitch_mm"]
        for column in range(0, volume.about["size"][0], 3):
            for row in range(0, volume.about["size"][1], 3):
                at = np.array([first_x + column * pitch[0], first_y + row * pitch[1], plane["slice"] * case.pitch[2]])
                if not all(0.5 < (at[k] / 1000 + case.origin[k] / 1000 - plane["origin_m"][k]) / np.linalg.norm(plane[way]) < plane[count] - 1.5
                           for k, way, count in ((0, "column_m", "columns"), (1, "row_m", "rows"))):
                    continue
                places.append(((at + case.origin) / 1000).tolist())
                stored.append(hu.get((column, row)))
    found = page_computes(answer, hu=places)["hu"]
    pairs = [(a, b) for a, b in zip(found, stored) if b is not None]
    assert len(pairs) > 1000
    assert max(abs(a - b) for a, b in pairs) < 0.5  # places are exact to rounding only


def test_directions_of_the_planes_and_angles(sample):
    case, answer, about = sample
    way_lps = np.array([0.2, -0.9, 0.3])
    way_lps /= np.linalg.norm(way_lps)
    axis = -(case.axes.T @ way_lps)  # up the shaft, in {B}
    out = page_computes(answer, tip=about["middle_m"], axis=axis.tolist())
    assert out["angles"]["cranial_deg"] == pytest.approx(math.degrees(math.asin(way_lps[2])), abs=1e-3)
    assert out["angles"]["lateral_deg"] == pytest.approx(math.degrees(math.atan2(0.2, 0.9)), abs=1e-3)
    expected = {"axial": ([1, 0, 0], [0, -1, 0]), "coronal": ([1, 0, 0], [0, 0, 1]), "sagittal": ([0, 1, 0], [0, 0, 1])}
    for name, axes in expected.items():
        assert np.allclose([case.axes @ axis for axis in out["axes"][name]], axes, atol=1e-5), name
    right, up = map(np.array, out["axes"]["needle"])
    assert np.allclose(up, axis) and abs(right @ up) < 1e-9 and abs(np.linalg.norm(right) - 1) < 1e-9
    # The values of a plane are those at its places: 5 x 5 over 30 mm, from the upper left.
    places = [(np.array(about["middle_m"]) + (column - 2) * 0.006 * right + (2 - row) * 0.006 * up).tolist() for row in range(5) for column in range(5)]
    assert out["planes"]["needle"] == pytest.approx(page_computes(answer, hu=places)["hu"], nan_ok=True, abs=1e-6)


def test_window_is_that_of_dicom(sample):
    """Examples of PS3.3, C.11.2.1.2.1: c=2048, w=4096; c=2048, w=1; c=0, w=100; c=0, w=1."""
    _, answer, _ = sample

    def dicom(x, c, w):
        if x <= c - 0.5 - (w - 1) / 2:
            return 0
        if x > c - 0.5 + (w - 1) / 2:
            return 255
        return math.floor(((x - (c - 0.5)) / (w - 1) + 0.5) * 255 + 0.5)
    windows = [(x, c, w) for c, w in ((2048, 4096), (2048, 1), (0, 100), (0, 1), (40, 400), (500, 2000)) for x in range(-1100, 4200, 37)]
    assert page_computes(answer, windows=windows)["greys"] == [dicom(*window) for window in windows]


def container(planes):
    """An answer of /api/volume with square planes of bone, 8 x 8 samples of 1 mm, at these heights in mm."""
    hu, inside = np.full(64, 1000, "<i2").tobytes(), np.full(64, 16, "u1").tobytes()
    about = {"schema": "trocar.volume/1", "patient": {"left": [1, 0, 0], "back": [0, 1, 0], "head": [0, 0, 1]}, "middle_m": [0.0035, 0.0035, (planes[0] + planes[-1]) / 2000],
             "context": None, "bone": {"step_HU": 8, "every": 1, "planes": [
                 {"slice": i, "origin_m": [0, 0, z / 1000], "column_m": [0.001, 0, 0], "row_m": [0, 0.001, 0], "columns": 8, "rows": 8,
                  "hu": [0, 64], "inside": [128, 64]} for i, z in enumerate(planes)]}}
    text = json.dumps(about).encode()
    text += b" " * (-(4 + len(text)) % 8)
    return len(text).to_bytes(4, "little") + text + hu + inside


@pytest.mark.parametrize("planes, thick_mm", [((0,), 1), ((0, 1, 2, 3), 4), ((0, 1, 2, 22, 23, 24), 6), ((0, 1, 2.7, 4), 5.3)])
def test_stacks(planes, thick_mm):
    """The whole picture, seen from the side, has the water of the slices: no bone is invented between slices that are far apart, and a slice
    that is alone counts."""
    view = [{"turn_deg": 0, "tilt_deg": 0, "width_m": 0.06, "size": 240, "file": str(WORK / "side.f32")}]
    places = [[0.0035, 0.0035, z / 1000] for z in (planes[0], planes[-1], (planes[0] + planes[-1]) / 2)]
    out = page_computes(container(planes), sums=view, hu=places)
    water_mm3 = float(np.fromfile(WORK / "side.f32", np.float32).sum()) * 0.25**2
    assert out["hu"] == [1000, 1000, None if len(planes) == 6 else 1000]
    assert water_mm3 == pytest.approx(0.96 * 8 * 8 * thick_mm, rel=0.05)


def test_no_xray_says_why(console):
    scene = json.loads((SOURCE / "runtime/scenes/three_slices.json").read_text())
    run(PROGRAMS / "trocar-mesh", SCAN / "dicom", "-o", WORK / "without.glb", "--quiet", "--no-hu")
    run(PROGRAMS / "trocar-mesh", SCAN / "dicom", "-o", WORK / "with.glb", "--quiet")
    top = scene["slices"][0]["z_m"]
    for slice_, height in zip(scene["slices"], (top, top - 0.02, top - 0.05)):
        slice_["z_m"] = height
    (WORK / "tilted_scan").mkdir(exist_ok=True)
    for file in (SCAN / "dicom").iterdir():
        image = pydicom.dcmread(file)
        x, y, z = map(float, image.ImagePositionPatient)
        image.ImagePositionPatient = [x, round(y + 0.25 * z, 3), z]
        image.save_as(WORK / "tilted_scan" / file.name)
    run(PROGRAMS / "trocar-mesh", WORK / "tilted_scan", "-o", WORK / "tilted.glb", "--quiet")
    for name, asset, why in (("without", "without.glb", "The asset has no HU."),
                             ("apart", "with.glb", "The scene's slices are not as far apart as in the scan."),
                             ("tilted", "tilted.glb", "The scan's slices are not straight above each other (a tilted gantry).")):
        if name != "apart":
            run(PROGRAMS / "trocar-run", "new-scene", WORK / asset, "-o", WORK / f"{name}.json")
        else:
            scene["asset"] = asset
            (WORK / f"{name}.json").write_text(json.dumps(scene))
        _, about = volume_of(console, name)
        assert about["bone"] is None and about["why"] == why, about
    assert console.get("/api/volume?scene=nothing.json")[0] == 404
    assert console.get("/api/volume?session=1")[0] == 409
    assert console.get("/api/volume?scene=planes.json", token=None)[0] == 401
