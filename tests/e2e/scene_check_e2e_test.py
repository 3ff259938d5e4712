# SPDX-License-Identifier: Apache-2.0
"""`trocar-run check` against the sessions that it judges.

The promise: `check --strict` ends with 0 exactly if the session on the same options, with the simulated device in virtual
time, ends with 0 without a fault, touches every slice, and renders every wrench in full, and no slice gets the default tissue
because none of the scene's tissues by HU or label fits it. Contact must also feel like bone, as `scene_check.h` states. Here sessions are run, on the shipped scenes, on scenes that are broken
in one way each and on random ones; what happened in them is read from recording and summary, and compared with the exit code.
Of a broken scene the warning must also name the time, value and limit.
"""
import json
import math
import pathlib
import random
import re
import subprocess

from exported import rows_of

REFUSED = 3
FAULT = 5
RANDOM_SCENES = 24
OPTIONS = [(), ("--rate", 500), ("--coupling", 10000), ("--force-law", "network"), ("--passivity", "off", "--compensate", "both")]
SEED = 20


def descent(*points, duration=None, slices=((17, 0.12),), **fields):
    """A scene with the tip at (t, x, y, z) or (t, x, y, z, rotation_deg)."""
    keyframes = [{"t_s": p[0], "tip_m": list(p[1:4]), **({"rotation_deg": list(p[4])} if len(p) > 4 else {})} for p in points]
    hand = {"stiffness_N_per_m": 8000, "damping_N_s_per_m": 140, **fields.pop("hand", {}), "trajectory": keyframes}
    return {"schema": "trocar.scene/1", "name": "test", "asset": "sample.glb", "duration_s": duration or points[-1][0] + 0.2,
            "placement": {"anchor_mm": [81.5, 53.6]}, "slices": [{"index": i, "z_m": z} for i, z in slices],
            "tool": {"sides": 6, "radius_m": 0.003}, "hand": hand, **fields}


DOWN = ((0, 0, 0, 0.14), (0.1, 0, 0, 0.14), (1.1, 0, 0, 0.10))
BONE = {"name": "bone", "hu": [2000, 3000], "stiffness_N_per_m": 9000, "threshold_N": 20}

# name: (scene, options, what the session ends with: exit code, patterns of the warning, each in one line)
BROKEN = {
    "starts_out_of_reach": (descent((0, 0.5, 0, 0.14), (1, 0.5, 0, 0.10)), (), REFUSED,
                            [r"at 0\.0000 s: the session cannot start.*\(0\.5000, 0\.0000, 0\.1400\) m.*out of reach.*x -0\.\d+ to 0\.\d+",
                             r"slice 17 at 0\.1\d+ m: .*nearest at \(0\.0\d+, "]),
    "leaves_box": (descent(*DOWN, (1.5, 0, 0, 0.16), (2.5, 0.07, 0, 0.16)), (), FAULT,
                   [r"at [12]\.\d+ s: .*fault workspace: plate x 60\.\d+ mm, limit 60 mm: keep"]),
    "below_box": (descent((0, 0, 0, 0.14), (1.5, 0, 0, 0.03)), (), FAULT,
                  [r"at 1\.\d+ s: .*fault [a-z_]+:.* m.*keep"]),
    "tilted": (descent(*DOWN, (1.6, 0, 0, 0.16), (2.6, 0, 0, 0.16, (50, 0, 0))), (), FAULT,
               [r"at 2\.\d+ s: .*fault workspace: plate tilt 34\.39 deg, limit 34\.38 deg: .*tilt"]),
    "tool_tilted": (descent((0, 0, 0, 0.15), (1, 0, 0, 0.15, (0, 30, 0)), tool={"tilt_deg": 30}, slices=((17, 0.16),)), (), FAULT,
                    [r"at 0\.\d+ s: .*fault tool_tilt.*45\.\d+ deg.*45 deg.*tilt",
                     r"slice 17 at 0\.1\d+ m: .*begins below"]),
    "too_fast": (descent(*DOWN, (1.5, 0, 0, 0.19), (1.52, 0, 0, 0.14), hand={"stiffness_N_per_m": 100000, "damping_N_s_per_m": 400}),
                 (), FAULT, [r"at 1\.5\d+ s: .*fault speed.* 2\.\d+ m/s.* 2 m/s.*slower"]),
    "joint_limit": (descent(*DOWN, (1.5, 0, 0, 0.21), (3, 0.055, 0.055, 0.21)), (), FAULT,
                    [r"at [12]\.\d+ s: .*fault joint_limit: angle theta \d of leg \d -?\d+\.\d+ deg, at (least|most) -?\d+ deg: keep"]),
    "too_strong": (descent((0, 0, 0, 0.14), (0.5, 0, 0, 0.13), (4, 0, 0, 0.08),
                           hand={"grip": "stiff", "stiffness_N_per_m": 30000, "damping_N_s_per_m": 400},
                           tissue={"stiffness_N_per_m": 50000, "threshold_N": 900}), (), None,
                   [r"motors.*6 Nm.*\d %|fault motor_overload", r"a contact at rest alternates by 0\.1\d N"]),
    "no_material": (descent(*DOWN, placement={"anchor_mm": [10, 10]}), (), 0,
                    [r"slice 17 at 0\.1\d+ m: .*0 % of the tool over material at 0\.\d+ s.*\(0\.0000, 0\.0000\) m.*material lies within x"]),
    "one_beside": (descent((0, 0, 0, 0.14), (2, 0.045, 0, 0.118), slices=((17, 0.135), (16, 0.1225))), (), 0,
                   [r"slice 16 at 0\.1\d+ m: .*material"]),
    "stays_above": (descent(*DOWN, slices=((17, 0.12), (16, 0.095), (15, 0.09))), (), 0,
                    [r"slices 15-16 at 0\.0900 to 0\.0950 m: .*stays above.*0\.1000 m"]),
    "too_short": (descent(*DOWN), ("--duration", "0.4"), 0,
                  [r"slice 17 at 0\.1\d+ m: .*goes below at 0\.6000 s.*ends at 0\.4 s.*--duration"]),
    "starts_below": (descent((0, 0, 0, 0.11), (1, 0, 0, 0.10)), (), 0, [r"slice 17 at 0\.1\d+ m: .*begins below.*0\.1100 m"]),
    "too_weak": (descent(*DOWN, slices=((17, 0.12), (16, 0.105)), hand={"stiffness_N_per_m": 500, "damping_N_s_per_m": 20}), (), 0,
                 [r"slice 16 at 0\.1\d+ m: .*no lower than 0\.11\d+ m.*slice 17 at 0\.1200 m bears it, with up to 9\.\d of 35 N"]),
    "too_weak_scaled": (descent(*DOWN, slices=((17, 0.12), (16, 0.105)), hand={"stiffness_N_per_m": 500, "damping_N_s_per_m": 20},
                                force_law={"kind": "hooke", "force_scale": 0.5}), (), 0,
                        [r"slice 16 at 0\.1\d+ m: .*slice 17 at 0\.1200 m bears it, with up to [89]\.\d of 17\.5 N"]),
    "shielded": (descent((0, 0, 0, 0.14), (1, 0, 0, 0.113), slices=((17, 0.12), (17, 0.119)), hand={"stiffness_N_per_m": 3000}), (), 0,
                 [r"slice 17 at 0\.1190 m: never touched: slice 17 at 0\.1200 m bears it, with up to 1\d\.\d of 35 N"]),
    "lets_go": (descent(*DOWN, hand={"let_go_t_s": 0.3}), (), 0, [r"slice 17 at 0\.1\d+ m: .*lets go at 0\.3 s.*0\.6000 s"]),
    "no_tissue_fits": (descent(*DOWN, tissues=[BONE]), (), 0,
                       [r"slice 17: .*mean HU \d+.*\"bone\" 2000 to 3000 HU.*5000 N/m and 35 N"]),
}
NEEDLE = json.loads((pathlib.Path(__file__).resolve().parents[2] / "runtime" / "scenes" / "vertebra.json").read_text())


def needle(**fields):
    """The shipped scene of a needle through the vertebra, with other fields, at the asset's place."""
    return {**NEEDLE, "asset": "sample.glb", **fields}


SOFT = {"stiffness_N_per_m": 20000, "cut": {**NEEDLE["tissue"]["cut"], "bed_N_per_mm3": 0.3}}
ELASTIC = {"kind": "cutting", "coupling_N_per_m": 20000, "force_scale": 0.5, "tip_hold": 0}
# What 0.2.0 proposed: bone that sinks in, snaps, and throws the plate out.
BROKEN |= {
    "snaps": (needle(tissue=SOFT, force_law=ELASTIC), (), 0,
              [r"at \d+\.\d+ s: the tip is \d+\.\d mm past the front.*at most 3\.0 mm",
               r"lets go is pushed away by up to \d+\.\d mm at [01]\.\d\d m/s.*0\.25 m/s|lets go in the bone causes the fault"]),
}

# Its warning is said by a session too, and the session is otherwise good.
ONLY_TISSUE = "no_tissue_fits"

GOOD = {
    "tissue_fits": descent(*DOWN, tissues=[{**BONE, "hu": [100, 3000]}]),
    "default_is_given": descent(*DOWN, tissues=[BONE], tissue={"threshold_N": 30}),
    "tissue_is_named": descent(*DOWN, tissues=[BONE], slices=()) | {"slices": [{"index": 17, "z_m": 0.12, "tissue": "bone"}]},
    # The path leaves the box, but the sheet holds the tool: no fault.
    "held_inside_box": descent((0, 0, 0, 0.14), (1.5, 0, 0, 0.05), hand={"stiffness_N_per_m": 300, "damping_N_s_per_m": 20}),
}


def random_scene(rng):
    x, y = rng.uniform(-0.02, 0.02), rng.uniform(-0.02, 0.02)
    axis = [rng.gauss(0, 1), rng.gauss(0, 1), 0]
    angle = rng.choice([0, rng.uniform(0, 40)]) / math.hypot(*axis)
    end = (rng.uniform(0.3, 1.2), x + rng.uniform(-0.01, 0.01), y + rng.uniform(-0.01, 0.01), rng.uniform(0.07, 0.11), [angle * a for a in axis])
    scene = descent((0, x, y, rng.uniform(0.14, 0.2)), end, slices=rng.sample([(16, 0.118), (17, 0.125), (18, 0.142)], rng.randint(1, 2)),
                    hand={"grip": rng.choice(["firm", "light", "stiff"])})
    if rng.random() < 0.7:
        del scene["hand"]["stiffness_N_per_m"], scene["hand"]["damping_N_s_per_m"]
    scene["tissue"] = {"threshold_N": rng.choice([5, 10, 35, 300]), "stiffness_N_per_m": rng.choice([2000, 5000, 20000])}
    return scene


def untimed(text):
    """Text without the time that the network took."""
    return re.sub(r"\d+ us to prepare", "", text)


def recorded(file):
    """The rows of a recording, with numbers as numbers."""
    return [{key: number(text) for key, text in row.items()} for row in rows_of(file)]


def number(text):
    try:
        return float(text)
    except ValueError:
        return text


def alternation(rows):
    """The force that alternates from tick to tick: the least of four successive changes, each against the last."""
    most = 0
    for axis in ("fx_wanted_N", "fy_wanted_N", "fz_wanted_N"):
        changes = [b[axis] - a[axis] for a, b in zip(rows, rows[1:], strict=False)]
        for four in zip(changes, changes[1:], changes[2:], changes[3:], strict=False):
            if all(a * b < 0 for a, b in zip(four, four[1:], strict=False)):
                most = max(most, min(map(abs, four)))
    return most


def snap(rows):
    """(how far the tip is past the front that bears it, the front's largest advance in a tick), in m."""
    past = max(row["front_z_m"] - row["z_m"] for row in rows if row["tip_N"] > 0)  # these scenes have the tip at the plate's origin
    jumps = [a["front_z_m"] - max(b["front_z_m"], b["tool_z_m"]) for a, b in zip(rows, rows[1:], strict=False) if b["cut_J"] > a["cut_J"]]
    return past, max(jumps)


class Judge:
    def __init__(self, programs, work, asset):
        self.trocar_run, self.work, self.asset = programs / "trocar-run", work, asset

    def call(self, *words):
        return subprocess.run([str(w) for w in (self.trocar_run, *words)], capture_output=True, text=True, check=False)

    def session(self, name, scene_file, options):
        """(exit code, whether it kept the promise's conditions except for tissues) of a session, from its files."""
        record, summary = self.work / f"{name}.csv", self.work / f"{name}_summary.json"
        done = self.call(scene_file, "--asset", self.asset, "--clock", "virtual", "--quiet", "--record", record, "--summary", summary,
                         "--black-box", self.work, *options)
        if done.returncode not in (0, FAULT):
            return done.returncode, False
        told = json.loads(summary.read_text())
        scene = json.loads(scene_file.read_text())
        heights = {piece["z_m"]: piece["index"] for piece in scene.get("slices", [])}
        touched = {event["slice_z_m"] for event in told["punctures"]}
        for row in rows_of(record):
            if row["state"] == "contact" and heights:
                slice_z = float(row["tool_z_m"]) + float(row["penetration_m"])
                touched.add(min((z for z, index in heights.items() if index == int(row["active_slice"])), key=lambda z: abs(z - slice_z)))
        # A path may end within a body: of its slices some must be touched, of a list all.
        met = touched == set(heights) if heights else bool(touched)
        rows = recorded(record)
        good = done.returncode == 0 and not told["faults"] and met and told["scaled_ticks"] == 0 and alternation(rows) <= 5
        if good and "front_z_m" in rows[0]:
            good = all(value <= limit for value, limit in zip(snap(rows), (3e-3, 1.5e-3), strict=True))
            good = good and all(value <= limit for value, limit in zip(self.let_go(name, scene, rows, options), (3e-3, 0.25), strict=True))
            cutting = told["cutting"]
            good = good and (cutting["coupling_N_per_m"] or 0) * cutting["force_scale"] <= cutting["stable_N_per_m"] * (1 + 1e-9)
        return done.returncode, good

    def let_go(self, name, scene, rows, options):
        """(largest distance, largest speed) of the plate after letting go at the ten moments that check takes."""
        pressed = [row["t_s"] for row in rows if math.hypot(row["fx_wanted_N"], row["fy_wanted_N"], row["fz_wanted_N"]) > 0.5]
        distance, speed, scene_file, record = 0, 0, self.work / f"{name}_lets_go.json", self.work / f"{name}_lets_go.csv"
        moments = [max(rows, key=lambda row: row["fz_wanted_N"])["t_s"], *(pressed[0] + (i + 0.5) / 9 * (pressed[-1] - pressed[0]) for i in range(9))]
        for at in moments:
            lets_go = {**scene, "asset": str(self.asset), "duration_s": min(scene["duration_s"], at + 0.4), "hand": {**scene["hand"], "let_go_t_s": at}}
            scene_file.write_text(json.dumps(lets_go))
            done = self.call(scene_file, "--clock", "virtual", "--quiet", "--record", record, "--black-box", self.work, *options)
            if done.returncode != 0:
                return math.inf, math.inf
            after = [(row["t_s"], (row["x_m"], row["y_m"], row["z_m"])) for row in recorded(record) if row["t_s"] >= at]
            distance = max(distance, *(math.dist(p, after[0][1]) for _, p in after))
            speed = max(speed, *(math.dist(p, q) / (t - s) for (s, p), (t, q) in zip(after, after[1:], strict=False)))
        return distance, speed

    def agrees(self, name, scene_file, options, strict):
        """Checks what --strict gave against the session, and returns the session's exit code."""
        code, good = self.session(name, scene_file, options)
        assert (strict.returncode == 0) == good or name == ONLY_TISSUE, (f"{name} {options}: the session ended with {code} "
              f"({'good' if good else 'not good'}), check --strict with {strict.returncode}: {strict.stderr}{strict.stdout}")
        return code

    def judged(self, name, scene, options=()):
        """Checks one scene, a file or its content, against its session: (session's exit code, warnings)."""
        scene_file = self.work / f"{name}.json"
        if isinstance(scene, pathlib.Path):
            scene_file = scene
        else:
            scene_file.write_text(json.dumps(scene))
        words = ("check", scene_file, "--asset", self.asset, *options)
        plain, strict = self.call(*words), self.call(*words, "--strict")
        lines = plain.stderr.splitlines()
        warnings = [line for line in lines if line.startswith(f"trocar-run: warning: {scene_file}: ")]
        assert plain.returncode == 0, f"{name}: check ended with {plain.returncode}: {plain.stderr}"
        assert warnings == lines, f"{name}: check says more than warnings: {plain.stderr}"
        assert strict.returncode == (REFUSED if warnings else 0), f"{name}: --strict ended with {strict.returncode}: {strict.stderr}"
        assert strict.stderr.splitlines()[:len(lines)] == lines and len(strict.stderr.splitlines()) == len(lines) + bool(lines), f"{name}: --strict says something else: {strict.stderr}"
        assert untimed(strict.stdout) == untimed(plain.stdout), f"{name}: --strict prints something else"
        return self.agrees(name, scene_file, options, strict), warnings


def check_broken(judge):
    for name, (scene, options, expected, patterns) in BROKEN.items():
        code, warnings = judge.judged(name, scene, options)
        assert expected is None or code == expected, f"{name}: the session ended with {code}, not {expected}"
        assert len(warnings) == len(patterns), f"{name}: {len(warnings)} warnings, not {len(patterns)}: {warnings}"
        for pattern in patterns:
            assert any(re.search(pattern, line) for line in warnings), f"{name}: no warning of {pattern}: {warnings}"
    # A session says the same at its start.
    scene_file = judge.work / f"{ONLY_TISSUE}.json"
    common = (scene_file, "--asset", judge.asset, "--clock", "virtual", "--duration", "0.01")
    said = judge.call(*common).stderr.splitlines()
    warned = judge.call("check", scene_file, "--asset", judge.asset).stderr.splitlines()
    assert said == warned and len(said) == 1, f"a session does not say that no tissue fits: {said}, check: {warned}"
    assert judge.call(*common, "--quiet").stderr == "", "--quiet: a warning of tissues"


def check_cutting(judge):
    """Forces and advice that differ with the force law `cutting`."""
    # A needle that stops in soft layers, above the bone.
    layers = [{"name": "skin", "top_z_m": 0.18, "thickness_m": 0.002, "stiffness_N_per_m": 400, "puncture_N": 1, "cutting_N": 0.5},
              {"name": "fascia", "top_z_m": 0.168, "thickness_m": 0.001, "stiffness_N_per_m": 1000, "puncture_N": 4, "cutting_N": 0.2}]
    keyframes = [{"t_s": t, "tip_m": [0, 0, z]} for t, z in ((0, 0.185), (0.1, 0.185), (2.5, 0.1665), (2.8, 0.1665))]
    soft = needle(layers=layers, force_law=NEEDLE["force_law"], duration_s=2.8,
                  hand={**NEEDLE["hand"], "trajectory": keyframes})
    _, warnings = judge.judged("soft_only", soft)
    untouched = r"slices 0-34 at 0\.1\d+ to 0\.1570 m: never touched: the path stays above, with the lowest tip at 0\.1665 m"
    assert any(re.search(untouched, line) for line in warnings), warnings
    # A hand too weak for a tissue that is cut. The threshold_N of such a tissue is not used.
    weak = descent(*DOWN, slices=((17, 0.12), (16, 0.105)), hand={"stiffness_N_per_m": 500, "damping_N_s_per_m": 20},
                   tissue={"cut": {"strength_MPa": 10, "tearing_N_per_m": 500}}, force_law={"kind": "cutting"})
    _, warnings = judge.judged("weak_needle", weak)
    held = r"slice 16 .* bears it, with up to \d+\.\d N: push deeper or with a stiffer hand, or lower force_scale"
    assert any(re.search(held, line) for line in warnings), warnings


def check_beyond_dry_run(judge):
    """A session longer than what check simulates is checked by its path from there on."""
    late = descent((0, 0, 0, 0.14), (1, 0, 0, 0.11), (2, 0, 0, 0.16), (700, 0, 0, 0.16), (701, 0.09, 0, 0.16), duration=900)
    (judge.work / "late.json").write_text(json.dumps(late))
    done = judge.call("check", judge.work / "late.json", "--asset", judge.asset)
    assert done.returncode == 0 and re.search(r"at 700\.\d+ s: .*path.*workspace.*x 0\.06\d+ m", done.stderr), f"late: {done}"
    assert re.search(r"dry run .*of 900 s", done.stdout), f"late: {done.stdout}"
    late["hand"]["trajectory"].pop()
    (judge.work / "long.json").write_text(json.dumps(late))
    done = judge.call("check", judge.work / "long.json", "--asset", judge.asset, "--strict")
    assert done.returncode == 0, f"long: {done}"


def check_random(judge):
    rng = random.Random(SEED)
    warned = 0
    for i in range(RANDOM_SCENES):
        scene_file, options = judge.work / f"random_{i}.json", rng.choice(OPTIONS)
        scene_file.write_text(json.dumps(random_scene(rng)))
        strict = judge.call("check", scene_file, "--asset", judge.asset, "--strict", *options)
        judge.agrees(scene_file.stem, scene_file, options, strict)
        warned += strict.returncode == REFUSED
    assert 6 <= warned <= RANDOM_SCENES - 6, f"{warned} of {RANDOM_SCENES} random scenes are warned of: too little is compared"


def test_scene_check(source, programs, asset, work):
    judge = Judge(programs, work, asset)
    for scene in sorted((source / "runtime" / "scenes").glob("*.json")):
        if json.loads(scene.read_text())["asset"] != "../../out/sample.glb" or scene.stem == "vertebra_live":
            continue  # of another scan, or without a path to try
        _, warnings = judge.judged(scene.stem, scene)
        assert not warnings, f"{scene.name}: {warnings}"
    for name, scene in GOOD.items():
        _, warnings = judge.judged(name, scene)
        assert not warnings, f"{name}: {warnings}"
    check_broken(judge)
    check_cutting(judge)
    check_beyond_dry_run(judge)
    check_random(judge)
