# SPDX-License-Identifier: Apache-2.0
"""The program trocar-mesh on 200 mutants (or TROCAR_MUTANTS) of the corpus: it
ends with 0 or 3 within 10 s, in 2 GB of address space, with one line on stderr if it refuses the
input and none otherwise, and leaves no output of a refused input. For a mutant without a voxel size
it ends with 2 and asks for --spacing; it is then run again with it."""
import os
import random
import resource
import shutil
import subprocess

from programs import SOURCE

MEMORY = 2 << 30
SECONDS = 10


def limit():
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def mutate(data, rng):
    data = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        if not data:
            break
        at = rng.randrange(min(len(data), 1024)) if rng.random() < 0.75 else rng.randrange(len(data))
        kind = rng.randrange(6)
        if kind == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[at] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        elif kind == 2:
            value = rng.choice((0, 1, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF))
            data[at:at + 4] = value.to_bytes(4, rng.choice(("little", "big")))[:len(data) - at]
        elif kind == 3:
            del data[rng.randrange(len(data)):]
        elif kind == 4:
            del data[at:at + rng.randrange(1, 64)]
        else:
            data[at:at] = data[at:at + rng.randrange(1, 64)]
    return bytes(data)


def run(order):
    try:
        done = subprocess.run(order, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False, timeout=SECONDS, preexec_fn=limit)
        return done.returncode, done.stderr.decode(errors="replace")
    except subprocess.TimeoutExpired:
        return "timeout", ""


def test_program_mutants(programs, work):
    mesh, corpus = programs / "trocar-mesh", SOURCE / "tests" / "corpus"
    count = int(os.environ.get("TROCAR_MUTANTS", "200"))
    rng = random.Random(20)
    seeds = sorted(f for kind in ("dicom", "glb", "image", "nifti") for f in (corpus / kind).iterdir())
    found, asked, ends = [], 0, {}
    for n in range(count):
        seed = rng.choice(seeds)
        kind = seed.parent.name
        suffix = ".nii.gz" if seed.name.endswith(".nii.gz") else seed.suffix
        source, asset = work / f"mutant{suffix}", work / "out.glb"
        source.write_bytes(mutate(seed.read_bytes(), rng))
        if kind == "glb":
            order = [mesh, rng.choice(("verify", "info")), source]
        else:
            material = ["--labels", "all"] if seed.name.startswith("seg_") else ["--threshold", "60"]
            order = [mesh, source, "-o", asset, "--quiet", "--jobs", "1", *material]
            if kind == "image":
                order += ["--spacing", "1,1,1"]
        code, said = run(order)
        if kind in ("dicom", "nifti") and code == 2 and said.count("\n") == 1 and "give --spacing X,Y,Z" in said and not asset.exists():
            asked += 1
            code, said = run([*order, "--spacing", "1,1,1"])
        ends[code] = ends.get(code, 0) + 1
        lines = len(said.splitlines())
        if code not in (0, 3) or lines != (1 if code == 3 else 0) or (code == 3 and asset.exists()):
            kept = work / f"found_{n}{suffix}"
            shutil.copy(source, kept)
            found.append(f"{kept} from {seed.name}: {code}, {said[:300]!r}")
        asset.unlink(missing_ok=True)
    print(f"{count} mutants, ends {ends}, {asked} asked for a spacing")
    assert not found, "\n".join(found)
