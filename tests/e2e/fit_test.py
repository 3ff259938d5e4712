# SPDX-License-Identifier: Apache-2.0
"""trocar-fit on curves of known tissues.

 1. The tissue that it writes is accepted by a scene and gives the forces of the curve back; the figure is a picture; wrong uses are
    refused in one line without an output.
 2. For each parameter, the true value is inside the 90 % interval in 85 to 95 % of 200 curves; hard layers are found and not invented.
    TROCAR_FIT_CURVES: number of curves (scripts/nightly: 200). With fewer, a parameter fails only if its part cannot be 85 %.
 3. Curves to which nothing can be fitted are refused."""
import collections
import concurrent.futures
import json
import math
import os
import subprocess

import jsonschema
import numpy as np
import pytest
import trocar_command
import trocar_fit
from programs import SOURCE
from synthetic_curve import Machine, Tissue, synthetic_curve

CURVES = int(os.environ.get("TROCAR_FIT_CURVES") or 12)
STIFFNESS, CUTTING, FRICTION, CONTACT = 200.0, 50.0, 1.5, 2.0  # N/mm, N, N/mm, mm


def write_curve(file):
    """An insertion of 20 mm and a withdrawal."""
    down = np.arange(0, 22, 0.05)
    u = np.maximum(down - CONTACT, 0)
    cut = np.maximum(u - CUTTING / STIFFNESS, 0)
    force = np.concatenate([np.minimum(STIFFNESS * u, CUTTING) + FRICTION * cut, -FRICTION * u[::-1]])
    force += np.random.default_rng(1).normal(0, 0.3, force.size)
    lines = [f"{d:.3f},{f:.4f}" for d, f in zip(np.concatenate([down, down[::-1]]), force)]
    file.write_text("depth_mm,force_N\n" + "\n".join(lines) + "\n")
    return file


def test_program(programs, work):
    file, tissue, figure = write_curve(work / "curve.csv"), work / "tissue.json", work / "fit.png"
    tool = work / "tool.json"
    tool.write_text('{"kind": "needle-conical", "radius_m": 0.0015, "sides": 32}')

    def fit(*words):
        return subprocess.run([str(word) for word in (programs / "trocar-fit", *words)], capture_output=True, text=True, check=False)

    done = fit(file, "--tool", tool, "-o", tissue, "--figure", figure)
    assert done.returncode == 0 and done.stderr == "", done
    assert "cutting force of the tip" in done.stdout and "90 % interval" in done.stdout, done.stdout
    made = json.loads(tissue.read_text())
    schema = json.loads((SOURCE / "formats/session/scene.schema.json").read_text())
    jsonschema.validate(made, {**schema["properties"]["tissue"], "$defs": schema["$defs"]})
    assert abs(made["threshold_N"] / CUTTING - 1) < 0.03, made
    assert abs(made["stiffness_N_per_m"] / (1e3 * STIFFNESS) - 1) < 0.1, made
    around_mm, area_mm2 = 2 * np.pi * 1.5, np.pi * 1.5**2
    assert abs(made["cut"]["friction_kPa"] / (1e3 * FRICTION / around_mm) - 1) < 0.05, made
    assert abs(made["cut"]["strength_MPa"] / (CUTTING / area_mm2) - 1) < 0.04, made
    assert figure.read_bytes().startswith(b"\x89PNG") and len(figure.read_bytes()) > 10_000

    again = work / "again.json"
    assert fit(file, "--tool", tool, "-o", again, "--quiet").stdout == "" and again.read_bytes() == tissue.read_bytes()

    refused = work / "refused.json"
    (work / "flat.csv").write_text("depth_mm,force_N\n" + "".join(f"{0.1 * i:.1f},3\n" for i in range(50)))
    (work / "wrong.json").write_text('{"radius": 1}')
    for code, said, words in (
            (3, "flat.csv: force_N is 3 in all rows", (work / "flat.csv", "--gauge", "11", "-o", refused)),
            (3, "tool.json: line 1", (tool, "--gauge", "11", "-o", refused)),
            (3, "none.csv: No such file", (work / "none.csv", "--gauge", "11", "-o", refused)),
            (3, "wrong.json: has neither", (file, "--tool", work / "wrong.json", "-o", refused)),
            (3, "curve.csv: has neither", (file, "--tool", file, "-o", refused)),
            (2, "one of the arguments --tool --gauge --diameter", (file, "-o", refused)),
            (2, "required: -o/--output", (file, "--gauge", "11")),
            (2, "--gauge: invalid choice: 12", (file, "--gauge", "12", "-o", refused)),
            (2, "--bore less than the diameter", (file, "--diameter", "3", "--bore", "3", "-o", refused)),
            (2, "would write over", (file, "--gauge", "11", "-o", file)),
            (2, "name the same file", (file, "--gauge", "11", "-o", refused, "--figure", refused)),
            (4, "no folder", (file, "--gauge", "11", "-o", work / "nowhere" / "t.json"))):
        done = fit(*words)
        error = done.stderr.replace("choice: '12'", "choice: 12")  # Python 3.13 quotes it
        assert done.returncode == code and said in error and done.stderr.count("\n") == 1 and not refused.exists(), f"{words}: {done}"


def test_tissue_gives_the_fit_back():
    """A scene multiplies the friction by the outline of the tool's polygon over that of the disc (bone_volume.cpp): 1.0501 for six sides."""
    p = np.array([0, 2, math.log(200), 50, 1.5, 0, 0, 0, 10, 0])
    fit = collections.namedtuple("Fit", "p")(p)
    radius = 1.5 * math.sqrt(6 / (2 * math.pi) * math.sin(2 * math.pi / 6))
    made = json.loads(trocar_fit.tissue_of(fit, (radius, 0.5, 1.0501)))
    assert made["cut"]["strength_MPa"] * math.pi * (radius**2 - 0.25) == pytest.approx(50, rel=1e-3)
    assert made["cut"]["modulus_MPa"] * 2 * radius / (1 - 0.3**2) == pytest.approx(200, rel=1e-3)
    assert made["cut"]["friction_kPa"] * 1e-3 * 2 * math.pi * (radius + 0.5) * 1.0501 == pytest.approx(1.5, rel=1e-3)
    p[trocar_fit.CUTTING] = 5000
    with pytest.raises(trocar_command.Failure, match="threshold_N is 5000"):
        trocar_fit.tissue_of(fit, (radius, 0, 1))


def case_of(k):
    """Every second curve has a hard layer; kinds of structure and withdrawals alternate more slowly, so that all combine. Rough
    structure is in the force only: a strength that jumps within micrometres makes the front stick at its peaks, so that its mean is not
    what any tool feels."""
    random = np.random.default_rng(11_000_000 + k)

    def log_within(low, high):
        return math.exp(random.uniform(math.log(low), math.log(high)))
    cutting = random.uniform(20, 150)
    tissue = Tissue(stiffness=log_within(80, 800), cutting=cutting, friction=cutting * random.uniform(0.01, 0.06),
                    drift=cutting * random.uniform(-0.005, 0.02))
    if k % 2:
        tissue.layer, tissue.thickness = cutting * random.uniform(1.5, 3), random.uniform(0.5, 2.5)
    kind = ("knots", "smooth", "rough")[k // 2 % 3]
    machine = Machine(contact=random.uniform(1, 5), travel=random.uniform(15, 30), spacing=log_within(0.01, 0.2), baseline=random.uniform(-2, 2),
                      noise=log_within(0.05, 2), structure=random.uniform(0.02, 0.08), kind=kind,
                      is_of_force=k // 6 % 2 == 1 or kind == "rough", withdraws=k // 12 % 2 == 1)
    fit = trocar_fit.fit_curve(synthetic_curve(tissue, machine, random), machine.diameter)
    return tissue, machine, {name: values for name, (_, values) in fit.rows.items()}, fit.p[trocar_fit.MIDDLE]


def test_intervals_contain_the_truth():
    inside, count = collections.Counter(), collections.Counter()
    with concurrent.futures.ProcessPoolExecutor() as pool:
        cases = list(pool.map(case_of, range(CURVES)))
    for tissue, machine, rows, middle in cases:
        count["unresolved"] += math.isinf(rows["stiffness before cutting"][2])
        count["layers"] += tissue.layer > 0
        has_layer = "force of the hard layer" in rows
        count["found"] += has_layer and tissue.layer > 0
        count["invented"] += has_layer and tissue.layer == 0
        assert ("drift of the cutting force" in rows) == machine.withdraws
        # Without a withdrawal the drift counts as friction, and the cutting force is that at the surface.
        truth = {"stiffness before cutting": tissue.stiffness, "cutting force of the tip": tissue.cutting + tissue.drift * middle * machine.withdraws,
                 "friction per length": tissue.friction + tissue.drift * (not machine.withdraws), "drift of the cutting force": tissue.drift}
        if tissue.layer > 0:
            truth |= {"force of the hard layer": tissue.layer, "thickness of the hard layer": tissue.thickness}
        if math.isinf(rows["stiffness before cutting"][2]):  # a lower bound is no interval of 90 %: it must nearly always hold
            count["bounds"] += rows["stiffness before cutting"][1] <= truth.pop("stiffness before cutting")
            # The curve has points enough for the stiffness while the force rises to 60 % of the first strength.
            count["needless"] += 0.6 * (tissue.layer or tissue.cutting) / tissue.stiffness >= 4 * machine.spacing
        for name in truth.keys() & rows.keys():
            inside[name] += rows[name][1] <= truth[name] <= rows[name][2]
            inside[name, "all"] += 1
    few = max(0, 200 - CURVES) and 3 * math.sqrt(0.85 * 0.15)  # three standard deviations of a part of fewer curves
    print({name: f"{n} of {inside[name, 'all']}" for name, n in inside.items() if isinstance(name, str)}, dict(count))
    for name in (name for name in list(inside) if isinstance(name, str)):
        n = inside[name, "all"]
        assert 0.85 - few / math.sqrt(n) <= inside[name] / n <= 0.95 + few, name
    assert count["found"] >= 0.95 * count["layers"] - bool(few) and count["invented"] <= 0.05 * (CURVES - count["layers"]) + bool(few)
    assert count["bounds"] >= 0.95 * count["unresolved"] - bool(few) and count["needless"] <= max(0.02 * CURVES, 1)


@pytest.mark.parametrize("force_N, noise_N, why", [
    (lambda z: 0 * z, 0.5, "no contact: the force never rises above its noise"),
    (lambda z: -np.minimum(20, 30 * np.maximum(z - 3, 0)), 0.01, "the force never rises, it falls; force_N must be positive"),
    (lambda z: 80 + z, 0.01, "begins with a force of 80"),
    (lambda z: 100 * np.maximum(z - 19.5, 0), 0.01, "only "),
    (lambda z: 30 * np.maximum(z - 3, 0), 0.01, "the force still rises steeply at the end: nothing was cut")])
def test_hopeless_curves(force_N, noise_N, why):
    depth = 0.05 * np.arange(400)
    force = force_N(depth) + np.random.default_rng(3).normal(0, noise_N, 400)
    with pytest.raises(trocar_command.Failure, match=f"^{why}") as failure:
        trocar_fit.fit_curve({"depth_mm": depth, "force_N": force}, 3)
    assert failure.value.code == 3


def csv(rows, depth, force=lambda i: 0.1 * i):
    return "depth_mm,force_N\n" + "".join(f"{depth(i):.6g},{force(i):.6g}\n" for i in range(rows))


HEAD = "depth_mm,force_N\n0,0\n"


@pytest.mark.parametrize("text, why", [
    ("", "the first line must name"), ("1,2\n", "the first line must name"), ("depth_mm,force_kN\n", "the first line must name"),
    ("depth_mm\n", "the first line must name"), ("," * 1_000_000, "the first line must name"),
    ("depth_mm,force_N,force_N\n", "line 1: a column occurs twice"), ("depth_mm,force_N\n", "has no row of numbers"),
    (HEAD + "a,1\n", "line 3: depth_mm is not a number"), (HEAD + "1,\n", "line 3: force_N is not a number"),
    (HEAD + "1,nan\n", "line 3: force_N is not finite"), (HEAD + "inf,1\n", "line 3: depth_mm is not finite"),
    (HEAD + "1,1e400\n", "line 3: force_N is not finite"), (HEAD + "1,2e5\n", "line 3: force_N is not finite, or beyond 100000"),
    (HEAD + "1,2,3\n", "line 3: must have 2 fields"), (HEAD + "1;2\n", "line 3: must have 2 fields"),
    (csv(10, lambda i: i), "has 10 rows"), (csv(50, lambda i: 0.1 * i, lambda i: 3), "force_N is 3 in all rows"),
    (csv(50, lambda i: 1e-4 * i), "depth_mm grows by 0.0049"), (csv(50, lambda i: 100 * i), "depth_mm grows by 4900"),
    (csv(50, lambda i: -0.1 * i), "depth_mm grows by 0 "), (csv(90, lambda i: 0.1 * i * (i % 2)), "depth_mm goes back and forth"),
    (HEAD + "1,2\n" * 200_000, "has more than 200000 rows")])
def test_refused_files(text, why):
    with pytest.raises(trocar_command.Failure, match=why) as failure:
        trocar_fit.branches_of(trocar_fit.parse_curve(text))
    assert failure.value.code == 3 and "\n" not in str(failure.value)
