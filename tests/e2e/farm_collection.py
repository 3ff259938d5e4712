# SPDX-License-Identifier: Apache-2.0
"""Shared by farm_test.py and snakemake_test.py: a collection of the sample scan, and what two stores must have in common."""
import datetime
import gzip
import hashlib
import json
import os
import pathlib

# What a store holds is a function of collection, files and program, the journal excepted; nothing is left under claims and tmp.
COMPARED = ("trocar-store.json", "actions", "content", "scans", "assets", "reports")
EMPTY = ("claims", "tmp")
VARIANTS = ({"slices": "5:8"}, {"slices": "10:12"}, {"slices": "15:18", "tolerance": 0.1}, {"slices": "20:22", "threshold": 180},
            {"slices": "8:10", "simplify": "dp"}, {"slices": "24:26", "min-angle": 25})


def make_collection(folder, sample, scans, broken):
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
    file.write_text(json.dumps({"schema": "trocar.collection/1", "scans": entries}))
    return file, wrong


def content_of(store):
    """Path: digest of the bytes, link target and mode of all that two equal stores have in common."""
    out = {}
    for name in COMPARED:
        for file in sorted([store / name, *(store / name).rglob("*")]):
            if file.is_symlink():
                out[str(file.relative_to(store))] = os.readlink(file)
            elif file.is_file():
                out[str(file.relative_to(store))] = (hashlib.sha256(file.read_bytes()).hexdigest(), oct(file.stat().st_mode & 0o777))
    return out


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
