# SPDX-License-Identifier: Apache-2.0
"""The law `cutting` with its default coupling gives a hand no energy, or `check --strict` refuses the scene.

Hands from undamped to firm shake the needle of the shipped scene at 5, 20 and 60 Hz in the bone, tap on it, and let it go, at rates from
250 to 8,000 Hz on the virtual clock. The summary's `given_max_J` is the largest net energy that the hand has received. Where it exceeds
the bound, or a session ends with a fault, the check of the same scene must end with exit code 3. From 400 Hz on, a little
more than six times 60 Hz, no session may exceed the bound. Prints the largest energy of each rate with `-s`.
"""
import json
import math
import os

from programs import ASSETS, PROGRAMS, SOURCE, WORK, run

RATES_HZ = (250, 400, 500, 1000, 2000, 4000, 8000) if int(os.environ.get("TROCAR_CAMPAIGN", "1")) > 1 else (250, 400, 1000, 4000)
PASSIVE_FROM_HZ = 400
HANDS = {"undamped": {"stiffness_N_per_m": 2000, "damping_N_s_per_m": 0}, "light": {"grip": "light"}, "firm": {"grip": "firm"},
         "stiff": {"grip": "stiff"}}
GIVEN_MAX_J = 1e-6
LET_GO_MAX_J = 20e-3
NEEDLE = json.loads((SOURCE / "runtime/scenes/vertebra.json").read_text())
TOP_M = NEEDLE["body"]["top_z_m"]
STEPS = 8  # keyframes of a period


def shaking(frequency_Hz):
    """Into the bone, then shaken along and across the needle for a second."""
    keyframes = [(0, 0, TOP_M + 0.003), (0.4, 0, TOP_M - 0.006)]
    for i in range(1, int(STEPS * frequency_Hz) + 1):
        wave = math.sin(2 * math.pi * i / STEPS)
        keyframes.append((0.4 + i / (STEPS * frequency_Hz), 0.0005 * wave, TOP_M - 0.006 - 0.001 * wave))
    return {"trajectory": keyframes}


def taps(frequency_Hz):
    return {"trajectory": [(i / (2 * frequency_Hz), 0, TOP_M + (0.003 if i % 2 == 0 else -0.001)) for i in range(int(2.4 * frequency_Hz) + 1)]}


def letting_go():
    return {"trajectory": [(0, 0, TOP_M + 0.003), (0.8, 0, TOP_M - 0.012)], "let_go_t_s": 0.7}


MOTIONS = {"5 Hz": shaking(5), "20 Hz": shaking(20), "60 Hz": shaking(60), "taps at 4 Hz": taps(4), "taps at 12 Hz": taps(12),
           "letting go": letting_go()}


def scene(rate_Hz, hand, motion):
    moves = {**motion, "trajectory": [{"t_s": t_s, "tip_m": [x_m, 0, z_m]} for t_s, x_m, z_m in motion["trajectory"]]}
    return {**NEEDLE, "asset": str(ASSETS / "sample.glb"), "rate_Hz": rate_Hz, "duration_s": 1.5, "hand": {**hand, **moves}}


def test_passive():
    trocar_run, file, told = PROGRAMS / "trocar-run", WORK / "scene.json", WORK / "summary.json"
    refused = 0
    for rate_Hz in RATES_HZ:
        largest_J = {"shaken or tapped": 0.0, "let go": 0.0}
        for hand, values in HANDS.items():
            for name, motion in MOTIONS.items():
                file.write_text(json.dumps(scene(rate_Hz, values, motion)))
                run(trocar_run, file, "--clock", "virtual", "--quiet", "--summary", told, expect=None)
                summary = json.loads(told.read_text())
                given_J, kind = summary["cutting"]["given_max_J"], "let go" if "let_go_t_s" in motion else "shaken or tapped"
                largest_J[kind] = max(largest_J[kind], given_J)
                if summary["end"] == "done" and given_J <= (LET_GO_MAX_J if kind == "let go" else GIVEN_MAX_J):
                    continue
                where = f"{rate_Hz} Hz, {hand} hand, {name}: {summary['end']}, {given_J:.2e} J"
                assert rate_Hz < PASSIVE_FROM_HZ, where
                assert run(trocar_run, "check", file, "--strict", "--quiet", expect=None).returncode == 3, where
                refused += 1
        print(f"{rate_Hz} Hz: at most", ", ".join(f"{1e3 * value:.2g} mJ {kind}" for kind, value in largest_J.items()))
    assert refused > 0, "the lowest rate shows that the test can see energy"


def test_default_coupling_has_no_stability_warning():
    file = WORK / "check.json"
    for rate_Hz in RATES_HZ:
        file.write_text(json.dumps({**NEEDLE, "asset": str(ASSETS / "sample.glb"), "rate_Hz": rate_Hz}))
        warnings = run(PROGRAMS / "trocar-run", "check", file, "--quiet").stderr
        assert ("allow only a soft coupling" in warnings) == (rate_Hz < PASSIVE_FROM_HZ), f"{rate_Hz} Hz: {warnings}"
