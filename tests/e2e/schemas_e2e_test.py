# SPDX-License-Identifier: Apache-2.0
"""What the programs write conforms to the JSON Schemas of formats/session/:
reports of trocar-mesh, summaries, frames and sheets of trocar-run. The same documents with one mistake each do not (the
mistakes come from the schema, see schema_test.py). Reports and summaries hold no absolute paths, whatever was given.
trocar-run takes the scenes that the schema takes, and refuses those that it refuses.
"""
import json
import re
import shutil
import struct
import subprocess

import jsonschema

import pytest
from device_link_e2e_test import Simulator
from programs import run
from mesh_program_e2e_test import label_map

from schema_test import mutations, replaced

LONG_LIST, SHORTENED = 4, 3  # of a longer list the first items are changed: the others are like them


class Schema:
    def __init__(self, source, name):
        self.name = name
        self.tree = json.loads((source / "formats" / "session" / f"{name}.schema.json").read_text())
        jsonschema.Draft202012Validator.check_schema(self.tree)
        self.id = self.tree.pop("$id")  # python3-jsonschema 4.10 joins a relative one to itself
        self.validator = jsonschema.Draft202012Validator(self.tree)
        self.documents, self.changes = 0, set()

    def check(self, what, document, part=None):
        """`part`: the definition to which the document belongs, if the schema is a choice of several."""
        self.documents += 1
        for error in list(self.validator.iter_errors(document))[:3]:
            pytest.fail(f"{what}: {error.json_path}: {error.message[:300]}")
        tree = {**self.tree["$defs"][part], "$defs": self.tree["$defs"]} if part else self.tree
        document = shortened(document)
        assert self.validator.is_valid(document), f"{what}: does not conform when its lists are shortened"
        for reason, changed in (*planted(document, document), *mutations(document, tree)):
            kind = re.sub(r"/\d+", "/N", reason)
            if kind not in self.changes:  # once for all items of a list, in all documents
                self.changes.add(kind)
                assert not self.validator.is_valid(changed), f"{what}: accepted although {reason}"


def shortened(node):
    """The document with the first items of its long lists."""
    if isinstance(node, dict):
        return {key: shortened(value) for key, value in node.items()}
    if not isinstance(node, list):
        return node
    return [shortened(value) for value in (node[:SHORTENED] if len(node) > LONG_LIST else node)]


def planted(document, node, path=()):
    """The document with a field that no schema has, in each of its objects."""
    if isinstance(node, dict):
        yield f"/{'/'.join(map(str, path))} has a planted field", replaced(document, path, {**node, "planted": 0})
    for key, child in node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ():
        yield from planted(document, child, path + (key,))


def texts(node):
    if isinstance(node, str):
        yield node
    for child in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from texts(child)


def check_to_be_shared(what, document, program, version, folders):
    assert document.get("program") == f"{program} {version}", f"{what}: program {document.get('program')!r}"
    for text in texts(document):
        assert not text.startswith("/") and not any(str(folder) in text for folder in folders), f"{what}: a path: {text!r}"


def reports(source, programs, scan, work):
    schema, mesh = Schema(source, "report"), programs / "trocar-mesh"
    version = run(mesh, "--version").stdout.split()[1]
    labelled = label_map(scan, work / "labels.nii", ((), (20, 21), (22, 23), ()))
    stray = work / "stray"
    stray.mkdir()
    for k, file in enumerate(sorted((scan / "dicom").iterdir())[3:6]):
        shutil.copy(file, stray / f"{k}.dcm")
    (stray / "note.txt").write_text("a note")
    magnetic, sheared = work / "magnetic", work / "sheared.nii"
    magnetic.mkdir()
    for file in sorted((scan / "dicom").iterdir())[3:6]:
        (magnetic / file.name).write_bytes(file.read_bytes().replace(b"\x08\x00\x60\x00CS\x02\x00CT", b"\x08\x00\x60\x00CS\x02\x00MR"))
    volume = bytearray(labelled.read_bytes())
    volume[80:92] = struct.pack("<3f", 1, 1, 2)  # pixdim, beside an sform of 1 mm
    sheared.write_bytes(volume)
    seen = set()
    for name, words in (
            ("solid", (scan / "sample.nii.gz", "--preset", "solid-bone", "--slices", "10:20", "--seed", "0,0,0")),
            ("skin", (scan / "sample.nii.gz", "--preset", "skin", "--slices", "10:14", "--context")),
            ("mask", (labelled, "--threshold", "1", "--mask", f"{labelled}:20-22")),
            ("modality", (magnetic, "--any-modality", "--threshold", "100")),
            ("volumes", (sheared, "--labels", "20-24")),
            ("dicom", (scan / "dicom", "--jobs", "1", "--simplify", "area", "--no-hu")),
            ("surface", (scan / "sample.nii.gz", "--grade", "400", "--surface", "--surface-triangles", "2000", "--slices", "10:20")),
            ("stray", (stray,)),
            ("paper", (scan / "png", "--spacing", "0.3125,0.3125,1", "--preset", "paper", "--crop", "0:60,0:60", "--slices", "0:9")),
            ("grey", (scan / "png", "--spacing", "0.3125,0.3125,1", "--threshold", "90", "--slices", "3:5")),
            ("labels", (labelled, "--labels", "20-22,99")),
            ("joined", (labelled, "--labels", "20+21,22")),
            ("all", (labelled, "--labels", "all")),
            ("coronal", (scan / "sample.nii.gz", "--axis", "coronal", "--slices", "100:130")),
            ("coarse", (scan / "sample.nii.gz", "--volume", "0", "--slices", "3:5", "--lattice-bits", "5", "--min-angle", "33", "--max-area", "0.01", "--keep-table", "--completeness-unknown"))):
        report = work / f"{name}.report.json"
        run(mesh, *words, "-o", work / f"{name}.glb", "--report", report, "--quiet")
        document = json.loads(report.read_bytes())
        schema.check(f"report {name}", document)
        seen |= {*document, *document["parameters"], *(key for warning in document["warnings"] for key in warning)}
        assert document["schema"] == schema.id, f"report {name}: {document['schema']}"
        check_to_be_shared(f"report {name}", document, "trocar-mesh", version, (work, scan))
    properties = schema.tree["properties"]
    for part in (schema.tree, properties["parameters"], properties["warnings"]["items"]):
        missing = part["properties"].keys() - seen - {"series"}  # needs the UID of a series
        assert not missing, f"no report had {missing}"
    return schema


def far_away(scene):
    """The scene with a hand that leaves the workspace and returns, which is a fault."""
    rests, leaves = [0, 0, 0.148], [0.2, 0, 0.148]
    keys = [(0, rests), (0.2, rests), (1.2, leaves), (2.0, rests)]
    return {**scene, "duration_s": 2.5, "hand": {"trajectory": [{"t_s": t_s, "tip_m": tip_m} for t_s, tip_m in keys]}}


def sessions(source, programs, work):
    """Runs sessions of each kind; the names of their summaries."""
    trocar_run, asset = programs / "trocar-run", work / "dicom.glb"
    scenes = {path.stem: path for path in (source / "runtime" / "scenes").glob("*.json")}
    away, replayed = work / "away.json", work / "three.csv"
    away.write_text(json.dumps(far_away(json.loads(scenes["one_slice"].read_text()))))
    fast = ("--clock", "virtual")
    for name, expect, words in (
            ("three", 0, (scenes["three_slices"], *fast, "--record", replayed)),
            ("replay", 0, ("replay", scenes["three_slices"], replayed)),
            ("network", 0, (scenes["network_middle"], *fast)),
            ("fault", 5, (away, *fast, "--black-box", work)),
            ("fault_record", 5, (away, *fast, "--record", work / "away.csv")),
            ("unwritten", 5, (away, *fast, "--black-box", work)),
            ("recovered", 0, (away, *fast, "--recover", "auto", "--black-box", work)),
            ("real", 0, (scenes["one_slice"], "--duration", "0.3"))):
        outputs = [word for kind in ("summary", "frames", "meshes") for word in (f"--{kind}", work / f"{name}.{kind}")]
        # A full disk for the black box, which is the largest of the files.
        limit = ("prlimit", "--fsize=200000") if name == "unwritten" else ()
        run(*limit, trocar_run, *words, *outputs, "--asset", asset, "--quiet", expect=expect)
        yield name
    # Over the device link.
    with Simulator(programs, work, scenes["one_slice"], "--clock", "lock-step", "--sessions", "1") as drive:
        run(trocar_run, scenes["one_slice"], *fast, "--asset", asset, *drive.link(), "--quiet",
            *[word for kind in ("summary", "frames", "meshes") for word in (f"--{kind}", work / f"link.{kind}")])
        assert drive.process.wait(30) == 0, f"the drive ended with {drive.process.returncode}"
    yield "link"


def outputs_of_sessions(source, programs, scan, work):
    summary, frames, sheets = (Schema(source, name) for name in ("summary", "frames", "sheets"))
    version, seen = run(programs / "trocar-run", "--version").stdout.split()[1], set()
    for name in sessions(source, programs, work):
        document = json.loads((work / f"{name}.summary").read_bytes())
        summary.check(f"summary {name}", document)
        assert document.get("schema") == summary.id, f"summary {name}: {document.get('schema')}"
        check_to_be_shared(f"summary {name}", document, "trocar-run", version, (work, scan, source))
        seen |= {key for key in ("replay", "network", "link") if key in document}
        for fault in document["faults"]:
            seen.add("recovered" if fault["recovered_t_s"] is not None else "fault")
            box, written = str(fault["black_box"]), "black_box_error" not in fault
            assert re.fullmatch(r"black_box_[^/]+\.csv", box) and (work / box).is_file() == written, f"{name}: black box {fault}"
            if not written:
                seen.add("unwritten")
                assert fault["black_box_error"].startswith(box) and "File too large" in fault["black_box_error"], f"{name}: {fault}"
        meshes = json.loads((work / f"{name}.meshes").read_bytes())
        sheets.check(f"sheets {name}", meshes)
        assert meshes["schema"] == sheets.id, f"sheets {name}: {meshes['schema']}"
        lines = {"frame": [], "shape": []}
        for text in (work / f"{name}.frames").read_text().splitlines():
            line = json.loads(text)
            lines["shape" if "w" in line else "frame"].append(line)
            assert frames.validator.is_valid(line), f"frames {name}: {text[:200]}"
        for part, of_part in lines.items():
            for line in of_part[:: max(1, len(of_part) // 3)]:
                frames.check(f"{part} of {name}", line, part)
            seen |= {part} if of_part else set()
    wanted = {"replay", "network", "link", "fault", "recovered", "unwritten", "frame", "shape"}
    assert seen >= wanted, f"no session had {wanted - seen}"
    return summary, frames, sheets


def scenes_of_cutting():
    """Scenes with each object of the force law `cutting`, by the definition of the law's object in the schema."""
    scene = {"schema": "trocar.scene/1", "name": "n", "asset": "surface.glb", "duration_s": 1,
             "hand": {"trajectory": [{"t_s": 0, "tip_m": [0, 0, 0.15]}]}}
    cut = {"strength_MPa": 4.5, "tearing_N_per_m": 500, "friction_kPa": 20, "bed_N_per_mm3": 12, "lateral_strength_MPa": 6}
    bone = {"law": "kopperdahl-linear", "density": "qct", "g_per_cm3_per_HU": 0.001, "g_per_cm3_at_0_HU": -0.02}
    law = {"kind": "cutting", "axis": "coupled", "coupling_N_per_m": 8000, "coupling_Nm_per_rad": 30, "prediction": "off",
           "force_scale": 0.25, "tip_hold": 0.1}
    body = {"from": 10, "to": 20, "top_z_m": 0.13, "shell": {"thickness_m": 0.0015, "strength_factor": 2.5}}
    yield "body", {**scene, "body": body, "tissue": {"cut": cut}, "force_law": law}
    box = {"min_m": [-0.1, -0.1, 0.05], "max_m": [0.1, 0.1, 0.08]}
    prism = {"outline_m": [[0, 0.02], [0.01, 0.02], [0.01, 0.03]], "z_m": [0.1, 0.15]}
    goals = {"target": {"at_m": [0, 0, 0.12], "radius_m": 0.003}, "force_max_N": 30, "time_max_s": 8, "plunge_max_m": 0.004,
             "line": {"entry_m": [0, 0, 0.15], "to_m": [0, 0, 0.1], "entry_radius_m": 0.004, "corridor_m": 0.005},
             "zones": [{"name": "vessel", "capsule": {"from_m": [0.03, 0, 0.1], "to_m": [0.03, 0, 0.2], "radius_m": 0.005}},
                       {"name": "lung", "box": box}, {"name": "canal", "margin_m": 0.002, "prism": prism}]}
    yield "goals", {**scene, "body": body, "tissue": {"cut": cut}, "force_law": law, "goals": goals}
    layer = {"name": "dura", "top_z_m": 0.14, "thickness_m": 0.0004, "stiffness_N_per_m": 150, "toughness_J_per_m2": 1500, "cutting_N": 0.1}
    yield "layers", {**scene, "body": body, "tissue": {"cut": cut}, "force_law": law, "layers": [layer]}
    shell = {"thickness_m": 0.001, "free_radius_m": 0.004}
    yield "bone", {**scene, "body": {**body, "shell": shell}, "force_law": {"kind": "cutting"},
                   "tissues": [{"name": "bone", "hu": [-1000, 3000], "cut": {"bone": bone}}]}
    yield "slices", {**scene, "slices": [{"index": 15, "z_m": 0.12}], "tissue": {"cut": {"bone": {"law": "kopperdahl-power"}}},
                     "force_law": {"kind": "cutting", "axis": "rigid"}}


def mistakes_in_scene(document, schema):
    """Those of mutations(), and those in what is a choice of several."""
    yield from mutations(document, schema)
    law = next(one for one in schema["properties"]["force_law"]["oneOf"]
               if one["properties"]["kind"]["const"] == document["force_law"]["kind"])
    for reason, changed in mutations(document["force_law"], {**law, "$defs": schema["$defs"]}):
        yield f"/force_law{reason}", {**document, "force_law": changed}
    yield "has both or none of slices and body", (
        {**document, "slices": [{"index": 15, "z_m": 0.12}]} if "body" in document else
        {key: value for key, value in document.items() if key != "slices"})
    for holder in (document.get("tissue"), *document.get("tissues", [])):
        if holder is None:
            continue
        for cut in ({**holder["cut"], "strength_MPa": 1, "bone": {"law": "kopperdahl-linear"}},
                    {key: value for key, value in holder["cut"].items() if key not in ("strength_MPa", "bone")}):
            changed = json.loads(json.dumps(document))
            target = changed["tissue"] if holder is document.get("tissue") else changed["tissues"][0]
            target["cut"] = cut
            yield "has both or none of strength_MPa and bone", changed


def scenes(source, programs, work):
    schema, trocar_run, made = Schema(source, "scene"), programs / "trocar-run", work / "scene.json"

    def check_scene(what, document, expect):
        made.write_text(json.dumps(document))
        rate = ("--rate", "8000") if '"rigid"' in made.read_text() else ()  # where a rigid axis is passive
        done = subprocess.run([trocar_run, "check", made, "--asset", work / "surface.glb", *rate], capture_output=True, text=True, check=False)
        assert done.returncode == expect, f"scene {what}: {done.returncode}, {done.stderr!r}"
        return done

    for name, document in scenes_of_cutting():
        schema.documents += 1
        for error in list(schema.validator.iter_errors(document))[:3]:
            pytest.fail(f"scene {name}: {error.json_path}: {error.message[:300]}")
        check_scene(name, document, 0)
        for reason, changed in (*planted(document, document), *mistakes_in_scene(document, schema.tree)):
            kind = re.sub(r"/\d+", "/N", f"{name} {reason}")
            if kind in schema.changes:
                continue
            schema.changes.add(kind)
            assert not schema.validator.is_valid(changed), f"scene {name}: the schema takes it although {reason}"
            said = check_scene(f"{name}, {reason}", changed, 3).stderr
            assert str(made) in said and said.count("\n") == 1, f"scene {name}: {reason}: {said!r}"
    return schema


def test_schemas(source, programs, scan, work):
    for schema in (reports(source, programs, scan, work), *outputs_of_sessions(source, programs, scan, work),
                   scenes(source, programs, work)):
        assert len(schema.changes) >= 50, f"{schema.name}: the schema forbids next to nothing ({len(schema.changes)} changes)"
        print(f"{schema.name}: {schema.documents} documents, {len(schema.changes)} kinds of mistakes in them")
