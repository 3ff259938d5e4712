# SPDX-License-Identifier: Apache-2.0
"""`trocar-run fit` on a curve of a known tissue: the tissue that it writes is accepted in a scene, the page is one file, and a wrong
curve or tool is refused in one line without an output."""
import json
import subprocess

import jsonschema
import numpy as np

from programs import SOURCE

STIFFNESS, CUTTING, FRICTION, CONTACT = 200.0, 50.0, 1.5, 2.0  # N/mm, N, N/mm, mm


def curve(file):
    """An insertion of 20 mm and a withdrawal."""
    noise = np.random.default_rng(1)
    down = np.arange(0, 22, 0.05)
    u = np.maximum(down - CONTACT, 0)
    cut = np.maximum(u - CUTTING / STIFFNESS, 0)
    up = down[::-1]
    force = np.concatenate([np.minimum(STIFFNESS * u, CUTTING) + FRICTION * cut, -FRICTION * u[::-1]])
    force += noise.normal(0, 0.3, force.size)
    lines = [f"{d:.3f},{f:.4f}" for d, f in zip(np.concatenate([down, up]), force)]
    file.write_text("depth_mm,force_N\n" + "\n".join(lines) + "\n")
    return file


def test_fit(programs, work):
    file, tissue, page = curve(work / "curve.csv"), work / "tissue.json", work / "fit.html"
    tool = work / "tool.json"
    tool.write_text('{"kind": "needle-conical", "radius_m": 0.0015, "sides": 32}')

    def fit(*words):
        return subprocess.run([str(word) for word in (programs / "trocar-run", "fit", *words)], capture_output=True, text=True, check=False)

    done = fit(file, "--tool", tool, "-o", tissue, "--page", page)
    assert done.returncode == 0 and done.stderr == "", done
    assert "cutting force of the tip" in done.stdout and "90 % interval" in done.stdout, done.stdout
    made = json.loads(tissue.read_text())
    schema = json.loads((SOURCE / "formats/session/scene.schema.json").read_text())
    jsonschema.validate(made, {**schema["properties"]["tissue"], "$defs": schema["$defs"]})
    assert abs(made["threshold_N"] / CUTTING - 1) < 0.03, made
    assert abs(made["stiffness_N_per_m"] / (1e3 * STIFFNESS) - 1) < 0.1, made
    around_mm = 2 * np.pi * 1.5
    assert abs(made["cut"]["friction_kPa"] / (1e3 * FRICTION / around_mm) - 1) < 0.05, made
    text = page.read_text()
    assert "<svg" in text and "http" not in text and "<script" not in text and "src=" not in text

    again = work / "again.json"
    assert fit(file, "--tool", tool, "-o", again, "--quiet").stdout == "" and again.read_bytes() == tissue.read_bytes()

    refused = work / "refused.json"
    (work / "flat.csv").write_text("depth_mm,force_N\n" + "".join(f"{0.1 * i:.1f},3\n" for i in range(50)))
    for code, said, words in (
            (3, "flat.csv: force_N is 3 in all rows", (work / "flat.csv", "--gauge", "11", "-o", refused)),
            (3, "tool.json: line 1", (tool, "--gauge", "11", "-o", refused)),
            (2, "fit: needs the tool", (file, "-o", refused)),
            (2, "--output is required", (file, "--gauge", "11")),
            (2, "--gauge 12", (file, "--gauge", "12", "-o", refused)),
            (2, "--half-angle: needs --tip", (file, "--gauge", "11", "--half-angle", "20", "-o", refused)),
            (2, "there are needle-bevel", (file, "--gauge", "11", "--tip", "spoon", "-o", refused)),
            (2, "would write over", (file, "--gauge", "11", "-o", file)),
            (4, "no folder", (file, "--gauge", "11", "-o", work / "nowhere" / "t.json"))):
        done = fit(*words)
        assert done.returncode == code and said in done.stderr and done.stderr.count("\n") == 1 and not refused.exists(), f"{words}: {done}"
    done = subprocess.run([str(programs / "trocar-run"), "--check", "fit", str(file), "--gauge", "11", "-o", str(refused)],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "leave --check out" in done.stderr, done
