# SPDX-License-Identifier: Apache-2.0
"""preview_test.py SOURCE PROGRAMS SCAN WORK: the sheets of trocar-mesh preview: their files, and their outlines, areas, counts and
orientations against the scan's NIfTI file, read by nibabel. The real scans TROCAR_REAL_CT and TROCAR_HEAD_CT are left out, saying
so, where they are missing."""
import base64
import io
import json
import os
import pathlib
import re
import shutil
import sys

import jsonschema
import nibabel
import numpy
import PIL.Image

from e2e import check, outcome, run

SOURCE, PROGRAMS, SCAN, WORK = map(pathlib.Path, sys.argv[1:])
MESH = PROGRAMS / "trocar-mesh"
THRESHOLD = 226
MOST_PX = 1.5  # from a pixel of the outline drawn to the outline, and back
MOST_AREA = 0.005  # of the area: outlines have straight pieces between the pixels' edges, and the sum here has 4 x 4 samples a pixel
MOST_MISSING = 0.03
FINE = 4
LETTERS = {"transverse": "RLAP", "coronal": "RLSI", "sagittal": "APSI"}  # left, right, top, bottom: as radiologists see them


def sheet(name, scan, *options):
    """The picture as RGB, and the numbers of its page."""
    png, page = WORK / f"{name}.png", WORK / f"{name}.html"
    said = run(MESH, "preview", scan, "-o", png, *options).stdout
    run(MESH, "preview", scan, "-o", page, "--quiet", *options)
    picture = numpy.asarray(PIL.Image.open(png).convert("RGB")).astype(int)
    check(f"{picture.shape[1]} x {picture.shape[0]} pixels" in said, f"{name}: another size than stated: {said}")
    text = page.read_text()
    check(not re.search(r"https?:|(src|href)=\"(?!data:)|url\(|@import", text), f"{name}: the page refers to other files")
    data = base64.b64decode(re.search(r'src="data:image/png;base64,([^"]*)"', text)[1])
    check(numpy.array_equal(numpy.asarray(PIL.Image.open(io.BytesIO(data))), picture), f"{name}: the page has another picture")
    numbers = json.loads(re.search(r'<script type="application/json" id="preview">(.*?)</script>', text, re.S)[1])
    schema = json.loads((SOURCE / "formats" / "session" / "preview.schema.json").read_text())
    schema.pop("$id")
    for error in list(jsonschema.Draft202012Validator(schema).iter_errors(numbers))[:3]:
        check(False, f"{name}: {error.json_path}: {error.message[:300]}")
    return picture, numbers


def slices_of(file, axis):
    """By a slice's place in mm: its values, in rows from the top of the picture and from its left."""
    image = nibabel.as_closest_canonical(nibabel.load(file))  # to the right, front, top
    values = numpy.asarray(image.dataobj).astype(float)
    along = {"sagittal": 0, "coronal": 1, "transverse": 2}[axis]
    sign = -1 if along == 1 else 1  # z_mm is along the slices' normal: to the right, back, top
    step, start = image.affine[along, along], image.affine[along, 3]

    def at(z_mm):
        k = round((sign * z_mm - start) / step)
        if along == 2:
            return values[::-1, ::-1, k].T
        return (values[::-1, k, ::-1] if along == 1 else values[k, ::-1, ::-1]).T

    return at


def interpolated(values, y, x):
    """Bilinear, at all pairs of rows y and columns x."""
    def weights(at, size):
        low = numpy.floor(at).astype(int)
        out = numpy.zeros((len(at), size))
        for k, part in ((low, 1 - (at - low)), (low + 1, at - low)):
            numpy.add.at(out, (numpy.arange(len(at)), k.clip(0, size - 1)), part)
        return out

    return weights(y, values.shape[0]) @ values @ weights(x, values.shape[1]).T


def within(mask, radius):
    """Pixels with one of the mask's at most so far away."""
    reach = int(radius)
    padded = numpy.pad(mask, reach)
    out = numpy.zeros_like(mask)
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if dy**2 + dx**2 <= radius**2:
                out |= padded[reach + dy:reach + dy + mask.shape[0], reach + dx:reach + dx + mask.shape[1]]
    return out


def check_outline(what, picture, numbers, shown, at):
    """The outline in the picture, found by its colour, against the line between the values below and from the threshold on."""
    x0, x1, y0, y1 = numbers["pixels_shown"]
    left, top, width, height = shown["tile_px"]
    tile = picture[top:top + height, left:left + width]
    drawn = tile[:, :, 0] - tile[:, :, 2] > 60
    values = at(shown["z_mm"])
    x = (numpy.arange(width) + 0.5) / width * (x1 - x0 + 1) - 0.5 + x0
    y = (numpy.arange(height) + 0.5) / height * (y1 - y0 + 1) - 0.5 + y0
    material = interpolated(values, y, x) >= THRESHOLD
    border = within(material, 1) & within(~material, 1)  # the outline is between them and a neighbour
    # At the scan's edges the outline is closed.
    inner = numpy.ones_like(material)
    inner[(y < 1.5) | (y > values.shape[0] - 2.5), :] = False
    inner[:, (x < 1.5) | (x > values.shape[1] - 2.5)] = False
    check(drawn.sum() > 100 and border.sum() > 100, f"{what}: {drawn.sum()} pixels of an outline, {border.sum()} expected")
    most = MOST_PX + 0.5  # the outline is half a pixel from the border's pixels
    wrong = (drawn & inner & ~within(border, most)).sum()
    check(wrong == 0, f"{what}: {wrong} of {drawn.sum()} pixels of the outline drawn are more than {most:.1f} from the scan's")
    # Letters and the scale bar may lie over it.
    missing = (border & inner & ~within(drawn, most)).sum() / border.sum()
    check(missing < MOST_MISSING, f"{what}: {100 * missing:.1f} % of the outline is not drawn")
    print(f"{what}: {wrong} of {drawn.sum()} pixels wrong, {100 * missing:.2f} % missing")


def check_numbers(name, numbers, at, area=True):
    images = [at(s["z_mm"]) for s in numbers["slices"]]
    histogram = numbers["histogram"]
    counts = numpy.zeros(len(histogram["counts"]), int)
    for image in images:
        bins = numpy.floor((image - histogram["low"]) / histogram["bin_width"]).astype(int)
        counts += numpy.bincount(bins.clip(0, len(counts) - 1).ravel(), minlength=len(counts))
    check(counts.tolist() == histogram["counts"], f"{name}: other counts in the histogram")
    changes = numbers["changes"]
    check([c["threshold"] for c in changes] == [THRESHOLD + c for c in (-50, -20, 0, 20, 50)], f"{name}: other thresholds")
    check(abs(changes[2]["area_mm2"] - sum(s["area_mm2"] for s in numbers["slices"])) < 1e-6, f"{name}: sum of areas")
    if not area:
        return
    expected = [0] * len(changes)
    for image, shown in zip(images, numbers["slices"]):
        rows, columns = (numpy.arange(FINE * (n - 1)) / FINE + 0.5 / FINE for n in image.shape)
        fine = interpolated(image, rows, columns)
        for k, change in enumerate(changes):
            expected[k] += (fine >= change["threshold"]).sum() / FINE**2 * numpy.prod(shown["spacing_mm"])
    for change, area_mm2 in zip(changes, expected):
        error = change["area_mm2"] / area_mm2 - 1
        check(abs(error) < MOST_AREA, f"{name}: area at {change['threshold']}: {change['area_mm2']:.1f} and not {area_mm2:.1f} mm2")


def check_scan(name, file, axis, count=3, phantom=False):
    picture, numbers = sheet(f"{name}_{axis}", file, "--axis", axis, "--count", count, "--min-region", 0)
    at = slices_of(file, axis)
    check(len(numbers["slices"]) == count, f"{name}, {axis}: {len(numbers['slices'])} slices")
    check_numbers(f"{name}, {axis}", numbers, at, phantom and axis == "transverse")
    for shown in numbers["slices"]:
        letters = "".join(shown["letters"][edge] for edge in ("left", "right", "top", "bottom"))
        check(letters == LETTERS[axis], f"{name}, {axis}: {letters} and not {LETTERS[axis]}")
    if not phantom:  # its single pixels of noise are islands smaller than the samples of check_outline()
        return
    middle = numbers["slices"][count // 2]
    check_outline(f"{name}, {axis}, slice {middle['index']}", picture, numbers, middle, at)


def check_same_bytes(file):
    for ending in ("png", "html"):
        one, two = WORK / f"one.{ending}", WORK / f"two.{ending}"
        for jobs, to in ((1, one), (2, two)):
            run(MESH, "preview", file, "-o", to, "--jobs", jobs, "--quiet")
        check(one.read_bytes() == two.read_bytes(), f".{ending}: other bytes with two threads")


def check_labels(file):
    labels = WORK / "labels.nii.gz"
    image = nibabel.load(file)
    map_of = numpy.digitize(numpy.asarray(image.dataobj), [200, 400]).astype(numpy.uint8)
    nibabel.save(nibabel.Nifti1Image(map_of, image.affine), labels)
    numbers = sheet("labels", labels, "--labels", "2")[1]
    at = slices_of(labels, "transverse")
    expected = [{"label": k, "voxels": int(sum((at(s["z_mm"]) == k).sum() for s in numbers["slices"]))} for k in (1, 2)]
    check(numbers["label_voxels"] == expected, f"labels: {numbers['label_voxels']} and not {expected}")


def check_refusals(file):
    images = WORK / "images"
    shutil.copytree(SCAN / "png", images)
    first, *_ = slices = sorted(images.glob("*.png"))
    before = {f.name: f.read_bytes() for f in slices}
    spacing = ("--spacing", "0.3,0.3,1", "--equalize", "230", "-o")
    for code, reason, words in (
            (2, "a preview is a .png or .html", (file, "-o", WORK / "sheet.jpg")),
            (2, "a preview is a .png or .html", (file, "-o", WORK / "sheet.glb")),
            (2, "would write over", (images, *spacing, first)),
            (2, "would write over", (file, "-o", first)),
            (2, "would become one of the scan's images", (*slices, *spacing, images / "sheet.png")),
            (3, "nothing is at or above the threshold of 30000", (file, "--threshold", "30000", "-o", WORK / "none.png"))):
        said = run(MESH, "preview", *words, expect=code).stderr
        check(reason in said and said.count("\n") == 1, f"refusal: {said!r} and not {reason!r}")
    check({f.name: f.read_bytes() for f in images.iterdir()} == before, "a refusal changed the scan's folder")
    check(not list(WORK.glob("sheet.*")) and not list(WORK.glob("none.*")), "a refusal left a file")
    sheet("again", file)
    run(MESH, "preview", file, "-o", WORK / "again.png", "--quiet")  # a sheet may be replaced


def main():
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    phantom = SCAN / "sample.nii.gz"
    check_scan("phantom", phantom, "transverse", phantom=True)
    for axis in ("coronal", "sagittal"):
        check_scan("phantom", phantom, axis, phantom=True)
    check_same_bytes(phantom)
    check_labels(phantom)
    check_refusals(phantom)
    for variable, name in (("TROCAR_REAL_CT", "sub-ct_label-22_ct.nii.gz"), ("TROCAR_HEAD_CT", "")):
        if not os.environ.get(variable):
            print(f"{variable} is not set: its scan is left out")
            continue
        for axis in LETTERS:
            check_scan(variable, pathlib.Path(os.environ[variable]) / name, axis)
    return outcome()


if __name__ == "__main__":
    sys.exit(main())
