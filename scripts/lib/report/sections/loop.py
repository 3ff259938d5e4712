# SPDX-License-Identifier: Apache-2.0
"""The loop: how sampling and holding destabilise a hand, and how the passivity controller prevents it.

Measured by the program loop_sweep: the simulated device is pressed into a sheet by a hand without
damping, tick by tick. Nothing here depends on the machine's speed."""
import json
import subprocess

import loop_plots as plots

TITLE = "Loop: stability against the hand"
ORDER = 50

RATES_HZ = (500, 1000, 2000, 4000, 8000)
WALLS = ((500, 5000), (1000, 5000), (1000, 30000))
PRESSED_N = 35


def plan(context):
    return {
        "rates_Hz": RATES_HZ, "traces": True,
        "walls": [{"rate_Hz": rate, "stiffness_N_per_m": stiffness, "pressed_N": PRESSED_N} for rate, stiffness in WALLS],
        "region": {"damping_N_s_per_m": [0, 0.5, 1, 1.5, 2, 3, 5, 10, 20, 40] if context.full else [0, 1, 2, 5, 10, 40],
                   "bisections": 10 if context.full else 8},
    }


def measure(context):
    done = subprocess.run([context.programs / "loop_sweep"], input=json.dumps(plan(context)), text=True,
                          stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def pairs(rows, *keys):
    """Pairs of rows: without the controller and with it."""
    of = {(*(row[key] for key in keys), row["passivity_controller"]): row for row in rows}
    return [(of[(*key, False)], of[(*key, True)]) for key in dict.fromkeys(tuple(row[k] for k in keys) for row in rows)]


def show(data, page):
    walls = pairs(data["walls"], "rate_Hz", "stiffness_N_per_m")
    worst = max(controlled["residual_oscillation_mm"] for _, controlled in walls)
    released = pairs(data["releases"], "rate_Hz")
    given = max(max(c["given_after_puncture_mJ"], c["given_by_press_and_lift_mJ"]) for _, c in released)
    page.text_block(
        f"Pressed to {PRESSED_N} N by a light hand without damping, with the controller: the tool still moves by {worst:.2g} mm after "
        f"two seconds (bound: 0.1 mm), including a 30 kN/m wall at 1 kHz; a release gives the hand {max(given, 0):.2g} mJ (bound: 1 mJ).", verdict=True)
    page.text_block(
        "A force held over a tick lags behind the motion by half a tick, which acts as a negative damping of K T / 2. Any passive hand is "
        "stable for b > K T / 2 + |B|, with b the device's own damping (here only the motors' friction) and B the wall's. "
        "The controller sums the work done on the hand, each force times the displacement that follows it, and compares it with the energy "
        "stored in the sheet. While the sheet gives energy back it adds the missing damping, up to 0.25 of the plate's mass over "
        "the period, at most 100 N s/m. It does not change the force while the hand pushes, so that a puncture follows the force law exactly.")
    page.plot(plots.traces(walls), f"Depth under a hand that goes down to {PRESSED_N} N in 0.55 s. Without the controller only an oscillation that "
              "the device's own friction damps is stable; the traces are clipped at the edges of the plots.")
    page.table(("wall", "device damping N s/m", "K T / 2 N s/m", "residual mm, plain", "controlled", "largest force N, plain", "controlled",
                "damping added at most N s/m"),
               [(f"{p['stiffness_N_per_m'] / 1e3:g} kN/m at {p['rate_Hz']:g} Hz", c["device_damping_N_s_per_m"],
                 p["needed_damping_K_T_over_2_N_s_per_m"], p["residual_oscillation_mm"], c["residual_oscillation_mm"],
                 p["largest_force_N"], c["largest_force_N"], c["damping_added_max_N_s_per_m"]) for p, c in walls])
    page.heading("The stable region")
    page.plot(plots.region(data["region"]), "The largest stiffness K of a wall against which an oscillation dies out, over the wall's own damping B, by rate: "
              "with the controller (full), without (open), and the bound b > K T / 2 + |B| (dotted). The bound holds for any passive hand; "
              "this hand is a light spring, for which B also helps.")
    page.table(("rate Hz", "B N s/m", "bound kN/m", "plain kN/m", "controlled kN/m", "times"),
               [(p["rate_Hz"], p["wall_damping_N_s_per_m"], p["bound_stiffness_N_per_m"] / 1e3, p["largest_stable_stiffness_N_per_m"] / 1e3,
                 c["largest_stable_stiffness_N_per_m"] / 1e3, c["largest_stable_stiffness_N_per_m"] / p["largest_stable_stiffness_N_per_m"])
                for p, c in pairs(data["region"], "rate_Hz", "wall_damping_N_s_per_m")], folded="all figures")
    page.heading("Energy at a release")
    page.table(("rate Hz", "taken before a puncture mJ", "given after it mJ", "given by press and lift mJ, plain", "controlled"),
               [(p["rate_Hz"], c["taken_before_puncture_mJ"], c["given_after_puncture_mJ"], p["given_by_press_and_lift_mJ"],
                 c["given_by_press_and_lift_mJ"]) for p, c in released])
    page.text_block("A 5 kN/m sheet. A puncture dissipates what the hand put in (122.5 mJ less half a tick), and gives nothing back. Lifting from 30 N: "
                    "negative means that the hand lost energy.")


def results(data):
    lines = ["| wall, hand without damping | residual oscillation mm | without the controller |", "| --- | --- | --- |"]
    for plain, controlled in pairs(data["walls"], "rate_Hz", "stiffness_N_per_m"):
        lines.append(f"| {plain['stiffness_N_per_m'] / 1e3:g} kN/m at {plain['rate_Hz']:g} Hz, {PRESSED_N} N | "
                     f"{controlled['residual_oscillation_mm']:.2g} | {plain['residual_oscillation_mm']:.2g} |")
    return lines
