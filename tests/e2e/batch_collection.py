# SPDX-License-Identifier: Apache-2.0
"""For the tests of trocar-mesh batch, by itself, in a farm and by Snakemake: collections of scans, and what is in a store."""
import datetime
import gzip
import json
import os
import pathlib
import shutil

import nibabel
import numpy

from programs import run

# What a store holds is a function of collection, files and program, the journal excepted; nothing is left under claims and tmp.
COMPARED = ("trocar-store.json", "actions", "content", "scans", "assets", "reports")
EMPTY = ("claims", "tmp")
VARIANTS = ({"slices": "5:8"}, {"slices": "10:12"}, {"slices": "15:18", "tolerance": 0.1}, {"slices": "20:22", "threshold": 180},
            {"slices": "8:10", "simplify": "dp"}, {"slices": "24:26", "min-angle": 25})


def label_map(file, source, crop):
    """Three labels by thresholds of a CT, on its grid."""
    ct = nibabel.load(source)
    hu = numpy.asarray(ct.dataobj)[crop]
    labels = (hu > 180).astype(numpy.int16) + (hu > 350) + (hu > 700)
    nibabel.save(nibabel.Nifti1Image(labels.astype(numpy.int16), ct.affine), file)


def make_scans(programs, folder, slices=4, size=64):
    """The phantom as DICOM, NIfTI and PNG, label maps of it, and L3 and head where they are."""
    run(programs / "trocar-sample-ct", folder / "phantom", "--slices", slices, "--size", size, "--quiet")
    whole = numpy.s_[:, :, :]
    label_map(folder / "labels.nii.gz", folder / "phantom/sample.nii.gz", whole)
    scans = {}
    l3 = pathlib.Path(os.environ.get("TROCAR_REAL_CT", "")) / "l3"
    if (l3 / "sub-ct_label-22_ct.nii.gz").is_file():
        shutil.copy(l3 / "sub-ct_label-22_ct.nii.gz", folder / "l3.nii.gz")
        shutil.copy(l3 / "sub-ct_seg-vert_label-22_msk.nii.gz", folder / "l3_labels.nii.gz")
        for file in folder.glob("l3*"):
            file.chmod(0o644)
        scans["l3"] = folder / "l3.nii.gz"
    head = pathlib.Path(os.environ.get("TROCAR_HEAD_CT", "") or "/nowhere")
    if head.is_file():
        shutil.copy(head, folder / "head.nii.gz")
        scans["head"] = folder / "head.nii.gz"
    return scans


def broken(folder):
    """Ten scans that cannot be meshed: (name, scan, exit code)."""
    whole = (folder / "phantom/sample.nii.gz").read_bytes()
    bad = folder / "broken"
    bad.mkdir(exist_ok=True)
    (bad / "truncated.nii.gz").write_bytes(whole[:len(whole) // 2])
    (bad / "empty.nii.gz").write_bytes(b"")
    (bad / "text.nii").write_text("not a scan\n")
    (bad / "nothing").mkdir(exist_ok=True)
    (bad / "folder.nii.gz").mkdir(exist_ok=True)
    shutil.copytree(folder / "phantom/dicom", bad / "dicom", dirs_exist_ok=True)
    slice_2 = sorted((bad / "dicom").iterdir())[2]
    slice_2.write_bytes(slice_2.read_bytes()[:-500])
    return [
        ("bad_truncated", {"input": "broken/truncated.nii.gz"}, 3),
        ("bad_empty", {"input": "broken/empty.nii.gz"}, 3),
        ("bad_text", {"input": "broken/text.nii"}, 3),
        ("bad_missing", {"input": "broken/missing.nii.gz"}, 3),
        ("bad_nothing", {"input": "broken/nothing"}, 3),
        ("bad_folder", {"input": "broken/folder.nii.gz"}, 3),
        ("bad_dicom", {"input": "broken/dicom"}, 3),
        ("bad_glob", {"input": {"glob": "broken/*.png"}}, 3),
        ("bad_crop", {"input": "phantom/sample.nii.gz", "parameters": {"crop": "0:5000,0:9"}}, 2),
        ("bad_level", {"input": "phantom/sample.nii.gz", "parameters": {"threshold": 30000}}, 3),
    ]


def collection_of_200(programs, folder):
    """Writes collection.json with 200 scans, ten of them broken. Returns {name: exit code} of these."""
    folder.mkdir(parents=True)
    real = make_scans(programs, folder)
    scans = []

    def add(name, source, **parameters):
        scans.append({"name": name, "input": source, **({"parameters": parameters} if parameters else {})})

    nifti, png = "phantom/sample.nii.gz", {"glob": "phantom/png/*.png"}
    dicom, spacing = {"folder": "phantom/dicom", "series": 1}, "2.5,2.5,1"
    for name, file in real.items():
        for k in range(10):
            # Where there is bone: the corners of the head's slices are air.
            first, left, top, size = (40, 80, 60, 120) if name == "head" else (0, 0, 5, 40)
            add(f"{name}_{k}", file.name, slices=f"{first + 2 * k}:{first + 2 * k + 1}", crop=f"{left + k}:{left + size + k},{top}:{top + size}",
                threshold=100 + 20 * k)
    if "l3" in real:
        for k in range(4):
            add(f"l3_labels_{k}", "l3_labels.nii.gz", labels="all", slices=f"{5 + k}:{6 + k}", hu="l3.nii.gz")
    for k in range(20):
        add(f"labels_{k}", "labels.nii.gz", labels=["1", "2+3"] if k % 2 else "all", slices=f"{k % 3}:{k % 3 + 1}", tolerance=(5 + k) / 50)
        add(f"png_{k}", png, spacing=spacing, equalize=200 + k)
        add(f"dicom_{k}", dicom, threshold=200 + 5 * k)
    k = 0
    while len(scans) < 190:
        add(f"crop_{k}", nifti, crop=f"{k % 8}:{52 + k % 9},{k % 5}:60", threshold=150 + k)
        k += 1
    codes = {}
    for name, scan, code in broken(folder):
        scans.append({"name": name, **scan})
        codes[name] = code
    assert len(scans) == 200
    write_collection(folder / "collection.json", scans, {"min-angle": 28})
    return codes


def write_collection(file, scans, defaults=None):
    file.write_text(json.dumps({"schema": "trocar.collection/1", "defaults": defaults or {}, "scans": scans}))
    return file


def collection_of_samples(folder, sample, scans, broken):
    """`scans` entries of the sample's three forms, and of L3 and its label map if TROCAR_REAL_CT has it; `broken` of them refused.
    Returns the collection's file and the names of the broken ones."""
    folder.mkdir(parents=True, exist_ok=True)
    whole = (sample / "sample.nii.gz").read_bytes()
    (folder / "truncated.nii.gz").write_bytes(whole[:len(whole) // 2])
    (folder / "text.nii.gz").write_bytes(gzip.compress(b"not an image\n" * 100))
    (folder / "empty").mkdir(exist_ok=True)
    (folder / "noise.nii").write_bytes(bytes(range(256)) * 40)
    bad = ["truncated.nii.gz", "text.nii.gz", "empty", "noise.nii", "missing.nii.gz"]
    forms = [(str(sample / "sample.nii.gz"), {}), (str(sample / "dicom"), {}), (str(sample / "png"), {"equalize": 230, "spacing": "0.3,0.3,1"})]
    real = pathlib.Path(os.environ.get("TROCAR_REAL_CT", "")) / "l3"
    l3, labels = real / "sub-ct_label-22_ct.nii.gz", real / "sub-ct_seg-vert_label-22_msk.nii.gz"
    if l3.is_file() and labels.is_file():
        forms += [(str(l3), {"crop": "10:65,5:65"}), (str(labels), {"labels": "22"})]
    entries, wrong = [], []
    for k in range(scans):
        source, fixed = forms[k % len(forms)]
        parameters = {**VARIANTS[k // len(forms) % len(VARIANTS)], "max-area": 20 + k, **fixed}
        if "equalize" in fixed or "labels" in fixed:
            parameters.pop("threshold", None)
        name = f"s{k:04}"
        if broken and k % (scans // broken) == 1 and len(wrong) < broken:
            wrong.append(name)
            source = bad[len(wrong) % len(bad)]
        entries.append({"name": name, "input": source, "parameters": parameters})
    file = folder / "collection.json"
    write_collection(file, entries)
    return file, wrong


def snapshot(store):
    """{path: (bytes, mode), or a link's text} of what two equal stores have in common."""
    out = {}
    for top in COMPARED:
        for path in sorted([store / top, *(store / top).rglob("*")]):
            if path.is_symlink():
                out[str(path.relative_to(store))] = os.readlink(path)
            elif path.is_file():
                out[str(path.relative_to(store))] = (path.read_bytes(), path.stat().st_mode & 0o777)
    return out


def difference(a, b):
    """The first paths at which two snapshots differ."""
    return sorted(path for path in a.keys() | b.keys() if a.get(path) != b.get(path))[:5]


def strays(store):
    """Files that a run should not have left, in and beside the store."""
    known = {*COMPARED, *EMPTY, "journal", "products"}
    left = [file for name in EMPTY if (store / name).exists() for file in (store / name).iterdir()]
    left += [file for file in store.iterdir() if file.name not in known]
    return [str(file) for file in left if file.exists()]


def journal_of(store):
    rows = []
    for file in (store / "journal").glob("*.ndjson"):
        for line in file.read_text(errors="replace").splitlines():
            try:
                rows.append(json.loads(line))
            except ValueError:
                pass  # its writer was killed
    return rows


def made_again(store):
    """Keys that were computed although they had been finished before that. The journal's times are whole seconds at the end."""

    by_key = {}
    for row in journal_of(store):
        if row["outcome"] == "made":
            end = datetime.datetime.fromisoformat(row["time"].replace("Z", "+00:00")).timestamp()
            by_key.setdefault(row["key"], []).append((end - row["seconds"], end))
    out = []
    for key, times in by_key.items():
        first_end = min(end for _, end in times)
        out += [key for start, _ in times if start > first_end + 1]
    return out
