# SPDX-License-Identifier: Apache-2.0
"""The sheets of trocar-mesh preview: their files, and their outlines, areas, counts and
orientations against the scan's NIfTI file, read by nibabel. The real scans TROCAR_REAL_CT and TROCAR_HEAD_CT are left out, saying
so, where they are missing."""
import base64
import io
import pathlib
import re
import shutil

import nibabel
import numpy
import PIL.Image
import pydicom

from exported import conforms, read_rings
from programs import HEAD_CT, L3_SCAN, PROGRAMS, SCAN, WORK, run
from html_pages import check_self_contained, embedded_json, rendered, texts_of

MESH = PROGRAMS / "trocar-mesh"
THRESHOLD = 226
MOST_PX = 1  # from a pixel drawn to the contour, and from the contour to a pixel drawn
BEHIND_PX = 4  # letters and the scale bar, with their dark border, lie over the contours
MOST_BEHIND = 0.05  # of the contours
SAMPLES_PX = 16
EXACT = ("--tolerance", "0", "--min-angle", "0", "--max-area", "1e12")  # a run whose rings are the contours, nothing left out or added
LETTERS = {"transverse": "RLAP", "coronal": "RLSI", "sagittal": "APSI"}  # left, right, top, bottom: as radiologists see them


def check_rendered(name, page, shown, numbers):
    """What the reader sees: the title, the sheet's picture, and a row in the tables for each slice and change or label."""
    dom = rendered(page)
    if dom is None:
        return
    assert dom.count("<img ") == 1 and f'src="{shown["picture"]["src"]}"' in dom, f"{name}: the rendered page does not show the picture"
    texts = texts_of(dom)
    rows = len(numbers["slices"]) + len(numbers.get("changes") or numbers["label_voxels"])
    assert dom.count("<tr>") == rows + 2, f"{name}: {dom.count('<tr>')} rows in the tables and not {rows} with two heads"
    for text in (shown["title"], shown["size"], shown["options"], "Slices shown", *(str(s["index"]) for s in numbers["slices"]),
                 *(f"Warning ({w['code']}): {w['sentence']}" for w in numbers["warnings"]),
                 *(str(row["voxels"]) for row in numbers.get("label_voxels", ())), *(str(row["outlines"]) for row in numbers.get("changes", ()))):
        assert text in texts, f"{name}: the rendered page lacks {text!r}"


def sheet(name, scan, *options):
    """The picture as RGB, and the numbers of its page."""
    png, page = WORK / f"{name}.png", WORK / f"{name}.html"
    said = run(MESH, "preview", scan, "-o", png, *options).stdout
    run(MESH, "preview", scan, "-o", page, "--quiet", *options)
    picture = numpy.asarray(PIL.Image.open(png).convert("RGB")).astype(int)
    assert f"{picture.shape[1]} x {picture.shape[0]} pixels" in said, f"{name}: another size than stated: {said}"
    text = page.read_text()
    check_self_contained(name, text)
    shown = embedded_json(text, "page")
    data = base64.b64decode(shown["picture"]["src"].removeprefix("data:image/png;base64,"))
    assert numpy.array_equal(numpy.asarray(PIL.Image.open(io.BytesIO(data))), picture), f"{name}: the page has another picture"
    numbers = embedded_json(text, "preview")
    check_rendered(name, page, shown, numbers)
    conforms("preview", numbers, name)
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


def rings_of(scan, *options):
    """By a slice's index: its rings in mm, as a run with the same options and `trocar-mesh export` write them."""
    asset, folder = WORK / "run.glb", WORK / "run"
    shutil.rmtree(folder, ignore_errors=True)
    run(MESH, scan, "-o", asset, "--quiet", *EXACT, *options)
    run(MESH, "export", asset, "-o", folder)
    out = {}
    for file in folder.glob("*.poly"):
        out[int(file.stem.removeprefix("slice_"))] = read_rings(file)
    return out


def area_of(rings):
    return sum(numpy.cross(ring, numpy.roll(ring, -1, axis=0)).sum() / 2 for ring in rings)


def within(mask, radius):
    """Pixels with one of the mask's at most so far away."""
    padded = numpy.pad(mask, radius)
    out = numpy.zeros_like(mask)
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            if dy**2 + dx**2 <= radius**2:
                out |= padded[radius + dy:radius + dy + mask.shape[0], radius + dx:radius + dx + mask.shape[1]]
    return out


def drawn_pixels(tile, labels):
    """Those that are more than half a contour's, orange on grey or white on black and orange; those of letters, light blue."""
    red, blue = tile[:, :, 0], tile[:, :, 2]
    over = blue - red > 25
    return (blue > 127) & ~over if labels else red - blue > 127, over


def samples_of(rings, numbers, shown):
    """Points along the rings, x and y in pixels of the tile, whose first one's centre is 0."""
    x0, x1, y0, y1 = numbers["pixels_shown"]
    scale = numpy.array(shown["tile_px"][2:]) / (x1 - x0 + 1, y1 - y0 + 1)
    out = []
    for ring in rings:
        points = (ring / shown["spacing_mm"] - (x0, y0) + 0.5) * scale - 0.5
        for a, b in zip(points, numpy.roll(points, -1, axis=0)):
            out.append(a + numpy.linspace(0, 1, max(2, int(numpy.ceil(SAMPLES_PX * numpy.hypot(*(b - a))))))[:, None] * (b - a))
    return numpy.concatenate(out)


def check_outline(what, picture, numbers, shown, rings, labels=False):
    """The contours in the picture, found by their colour, against the run's, both ways."""
    left, top, width, height = shown["tile_px"]
    drawn, over = drawn_pixels(picture[top:top + height, left:left + width], labels)
    samples = samples_of(rings, numbers, shown)
    nearest = numpy.full((height, width), numpy.inf)  # of the rings to each pixel
    is_met = numpy.zeros(len(samples), bool)
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            pixels = numpy.rint(samples).astype(int) + (dx, dy)
            away = numpy.hypot(*(pixels - samples).T)
            inside = ((pixels >= 0) & (pixels < (width, height))).all(axis=1)
            x, y = pixels[inside].T
            numpy.minimum.at(nearest, (y, x), away[inside])
            is_met[inside] |= drawn[y, x] & (away[inside] <= MOST_PX)
    x, y = numpy.rint(samples).astype(int).T
    behind = within(over, BEHIND_PX)[y.clip(0, height - 1), x.clip(0, width - 1)]
    wrong = drawn & (nearest > MOST_PX)
    missing = ~is_met & ~behind
    assert not wrong.any(), f"{what}: {wrong.sum()} of {drawn.sum()} pixels drawn are more than {MOST_PX} from the run's contours"
    assert not missing.any(), f"{what}: {missing.sum() / len(samples):.2%} of the run's contours are not drawn"
    assert behind.mean() < MOST_BEHIND, f"{what}: {behind.mean():.2%} of the contours are behind letters"
    farthest = nearest[drawn].max(initial=0)
    print(f"{what}: {len(rings)} contours, {drawn.sum()} pixels, at most {farthest:.2f} px away; {behind.mean():.2%} behind letters")


def check_numbers(name, numbers, at):
    images = [at(s["z_mm"]) for s in numbers["slices"]]
    histogram = numbers["histogram"]
    counts = numpy.zeros(len(histogram["counts"]), int)
    for image in images:
        bins = numpy.floor((image - histogram["low"]) / histogram["bin_width"]).astype(int)
        counts += numpy.bincount(bins.clip(0, len(counts) - 1).ravel(), minlength=len(counts))
    assert counts.tolist() == histogram["counts"], f"{name}: other counts in the histogram"
    changes = numbers["changes"]
    assert [c["threshold"] for c in changes] == [THRESHOLD + c for c in (-50, -20, 0, 20, 50)], f"{name}: other thresholds"


def check_changes(name, scan, numbers, *options):
    """Areas and outlines at each threshold, of a run with that threshold: areas are sums of lattice triangles, exact but for the sum."""
    for change in numbers["changes"]:
        rings = rings_of(scan, *options, "--threshold", change["threshold"])
        areas = [area_of(rings.get(s["index"], [])) for s in numbers["slices"]]
        outlines = [len(rings.get(s["index"], [])) for s in numbers["slices"]]
        what = f"{name}, threshold {change['threshold']}"
        assert abs(change["area_mm2"] / sum(areas) - 1) < 1e-9, f"{what}: {change['area_mm2']} mm2 and not {sum(areas)}"
        assert change["outlines"] == sum(outlines), f"{what}: {change['outlines']} outlines and not {sum(outlines)}"
        if change["change"] != 0:
            continue
        for shown, area, count in zip(numbers["slices"], areas, outlines):
            said = f"{what}, slice {shown['index']}: {shown['area_mm2']} mm2, {shown['outlines']} outlines"
            assert abs(shown["area_mm2"] - area) < 1e-6 * max(1, area) and shown["outlines"] == count, f"{said} and not {area}, {count}"


def check_scan(name, file, axis, count=3):
    options = ("--axis", axis)
    picture, numbers = sheet(f"{name}_{axis}", file, *options, "--count", count)
    at = slices_of(file, axis)
    assert len(numbers["slices"]) == count, f"{name}, {axis}: {len(numbers['slices'])} slices"
    check_numbers(f"{name}, {axis}", numbers, at)
    for shown in numbers["slices"]:
        letters = "".join(shown["letters"][edge] for edge in ("left", "right", "top", "bottom"))
        assert letters == LETTERS[axis], f"{name}, {axis}: {letters} and not {LETTERS[axis]}"
        rings = rings_of(file, *options, "--slices", f"{shown['index']}:{shown['index']}")
        check_outline(f"{name}, {axis}, slice {shown['index']}", picture, numbers, shown, rings[shown["index"]])
    if axis == "transverse" and name != "head":
        check_changes(name, file, numbers, *options)


def check_options(file):
    """The options of a run have the same effect here."""
    for name, options in (("vertebra", ("--preset", "vertebra")),
                          ("solid", ("--threshold", "300", "--close", "2", "--fill", "all", "--largest", "1")),
                          ("pixels", ("--contour", "pixel", "--min-region", "30", "--crop", "150:400,120:380", "--slices", "5:20"))):
        picture, numbers = sheet(name, file, *options, "--count", "2")
        rings = rings_of(file, *options)
        for shown in numbers["slices"]:
            index = shown["index"]
            check_outline(f"{name}, slice {index}", picture, numbers, shown, rings[index])
            assert abs(shown["area_mm2"] / area_of(rings[index]) - 1) < 1e-9, f"{name}, slice {index}: another area than the run's"


def check_private(slices):
    """Nothing in the sheet and its page is from the headers' texts or the files' names, also where warnings on the terminal say them."""
    marks = []

    def mark():
        marks.append(f"MARK{len(marks):03}")
        return marks[-1]

    # One folder with two series, one of them short, and a file that is no DICOM.
    study = WORK / mark() / mark()
    study.mkdir(parents=True)
    for series, number in (("full", 16), ("short", 2)):
        uid, texts = pydicom.uid.generate_uid(entropy_srcs=[series]), {}
        for k, source in enumerate(sorted(slices.glob("*"))[:number]):
            image = pydicom.dcmread(source)
            image.SeriesInstanceUID, image.SOPInstanceUID = uid, pydicom.uid.generate_uid(entropy_srcs=[series, str(k)])
            image.file_meta.MediaStorageSOPInstanceUID = image.SOPInstanceUID
            for name, kind in (("PatientName", "PN"), ("PatientID", "LO"), ("OtherPatientNames", "PN"), ("PatientComments", "LT"),
                               ("SeriesDescription", "LO"), ("StudyDescription", "LO"), ("StudyID", "SH"), ("InstitutionName", "LO"),
                               ("ReferringPhysicianName", "PN"), ("AccessionNumber", "SH"), ("ConvolutionKernel", "SH"),
                               ("ProtocolName", "LO"), ("ImageComments", "LT"), ("StationName", "SH"), ("OperatorsName", "PN")):
                texts[name] = texts.get(name) or mark()
                image.add_new(name, kind, texts[name])
            for name in ("StudyDate", "SeriesDate", "PatientBirthDate", "AcquisitionDate"):
                setattr(image, name, "19370219")
            image.save_as(study / f"{texts['PatientName']}_{series}_{k}")
    (study / mark()).write_text("no image")
    marks += ["1937", str(uid), pathlib.Path.cwd().name]
    for scan in (study, str(study) + "/"):
        page, png = WORK / "private.html", WORK / "private.png"
        said = run(MESH, "preview", scan, "-o", page).stderr
        assert "MARK" in said and "other_series" in said and "not_dicom" in said, f"the terminal has no warnings to keep out: {said}"
        run(MESH, "preview", scan, "-o", png, "--quiet")
        text = re.sub(r'"data:[^"]*"', "", page.read_text())
        for word in (*marks, "MARK", str(WORK), "sample"):
            assert word not in text, f"the page has {word!r}"
            assert word.encode() not in png.read_bytes(), f"the picture's file has {word!r}"
        assert "other_series" in text and "not_dicom" in text, "the page has no warnings"


def check_same_bytes(file):
    for ending in ("png", "html"):
        one, two = WORK / f"one.{ending}", WORK / f"two.{ending}"
        for jobs, to in ((1, one), (2, two)):
            run(MESH, "preview", file, "-o", to, "--jobs", jobs, "--quiet")
        assert one.read_bytes() == two.read_bytes(), f".{ending}: other bytes with two threads"


def check_labels(file):
    labels = WORK / "labels.nii.gz"
    image = nibabel.load(file)
    map_of = numpy.digitize(numpy.asarray(image.dataobj), [200, 400]).astype(numpy.uint8)
    nibabel.save(nibabel.Nifti1Image(map_of, image.affine), labels)
    numbers = sheet("labels", labels, "--labels", "2")[1]
    at = slices_of(labels, "transverse")
    expected = [{"label": k, "voxels": int(sum((at(s["z_mm"]) == k).sum() for s in numbers["slices"]))} for k in (1, 2)]
    assert numbers["label_voxels"] == expected, f"labels: {numbers['label_voxels']} and not {expected}"
    nibabel.save(nibabel.Nifti1Image((map_of == 2).astype(numpy.uint8), image.affine), labels)
    picture, numbers = sheet("label", labels, "--labels", "1", "--count", "3")
    rings = rings_of(labels, "--labels", "1")
    for shown in numbers["slices"]:
        check_outline(f"label, slice {shown['index']}", picture, numbers, shown, rings[shown["index"]], labels=True)


def labelled(name, slices):
    """A label map of these slices, 1 mm apart, with pixels of 1 mm."""
    file = WORK / f"{name}.nii.gz"
    nibabel.save(nibabel.Nifti1Image(numpy.stack(slices, axis=2).astype(numpy.int16), numpy.eye(4)), file)
    return file


def check_many_labels():
    """A wanted label is always counted. If others are not, this is said."""
    for count, is_whole in ((4000, True), (6400, False)):
        labels = numpy.minimum(numpy.arange(80 * 80)[::-1], count).reshape(80, 80)  # the reader comes to the highest one last
        file = labelled("many", [labels, labels])
        page = WORK / "many.html"
        said = run(MESH, "preview", file, "--labels", str(labels.max()), "--min-region", "0", "--count", "1", "-o", page).stderr
        numbers = embedded_json(page.read_text(), "preview")
        counted = {row["label"]: row["voxels"] for row in numbers["label_voxels"]}
        assert counted[labels.max()] == (labels == labels.max()).sum(), f"{count} labels: the wanted one has {counted[labels.max()]} voxels"
        warned = [w["code"] for w in numbers["warnings"] if w["code"] == "labels_not_counted"]
        assert len(warned) == (0 if is_whole else 1) == said.count("(labels_not_counted)"), f"{count} labels: {numbers['warnings']}, {said}"
        assert (len(counted) == len(numpy.unique(labels)) - 1) == is_whole, f"{count} labels: {len(counted)} are counted"
        run(MESH, "preview", file, "--labels", "all", "--min-region", "0", "--count", "1", "-o", page, "--quiet")
        numbers = embedded_json(page.read_text(), "preview")
        assert len(numbers["label_voxels"]) == len(numpy.unique(labels)) - 1, f"{count} labels, all wanted: {len(numbers['label_voxels'])} are counted"


def check_inspected():
    """With more than 64 slices, the page says that it can miss material between two inspected ones."""
    block = numpy.zeros((24, 24), int)
    block[8:16, 8:16] = 1
    for slices, of in ((130, 64), (64, None)):
        full = {1, slices // 2}  # slices 0 and 2 of 130 are inspected, 1 is not
        file = labelled("sparse", [block * (k in full) for k in range(slices)])
        page = WORK / "sparse.html"
        run(MESH, "preview", file, "--labels", "1", "-o", page, "--quiet")
        size = embedded_json(page.read_text(), "page")["size"]
        first = embedded_json(page.read_text(), "preview")["slices"][0]["index"]
        assert (first == 1) == (of is None), f"{slices} slices: the first shown is {first}"
        assert (f"sought in {of} slices" in size) == ("sought in" in size) == (of is not None), f"{slices} slices: {size}"


def check_several_materials():
    """What meshing refuses for several materials, the preview refuses, too, by the same words."""
    two = numpy.zeros((24, 24), int)
    two[4:12, 4:20] = 1
    two[12:20, 4:20] = 2
    file = labelled("two", [two, two])
    for code, labels in ((2, "all"), (2, "1,2"), (0, "1+2"), (0, "1")):
        words = (file, "--labels", labels, "--contour", "pixel", "--quiet", "-o")
        meshed = run(MESH, *words, WORK / "two.glb", expect=code).stderr
        shown = run(MESH, "preview", *words, WORK / "two.png", expect=code).stderr
        assert shown == meshed, f"--labels {labels}: {shown!r} and not {meshed!r}"
        assert ("--contour pixel leaves gaps" in shown) == (code == 2), f"--labels {labels}: {shown!r}"


def test_preview():
    phantom = SCAN / "sample.nii.gz"
    for axis in LETTERS:
        check_scan("phantom", phantom, axis)
    check_options(phantom)
    check_same_bytes(phantom)
    check_labels(phantom)
    check_private(SCAN / "dicom")
    sheet("again", phantom)
    run(MESH, "preview", phantom, "-o", WORK / "again.png", "--quiet")  # a sheet may be replaced
    check_many_labels()
    check_inspected()
    check_several_materials()
    for name, file in (("L3", L3_SCAN), ("head", HEAD_CT)):
        if not file.is_file():
            print(f"{name}: not there, left out")
            continue
        for axis in LETTERS if name == "L3" else ("sagittal",):
            check_scan(name, file, axis)


def test_options_of_the_asset_have_no_effect():
    """So that the options of a run, and the parameters of a scan in a collection, can be given to its preview."""
    key = WORK / "preview.key"
    key.write_bytes(bytes(32))
    plain, other = WORK / "plain.png", WORK / "other.png"
    run(MESH, "preview", SCAN / "dicom", "-o", plain, "--quiet")
    run(MESH, "preview", SCAN / "dicom", "--lines", "--colour", "--context", "3", "--input-key", key, "-o", other, "--quiet")
    assert plain.read_bytes() == other.read_bytes()
