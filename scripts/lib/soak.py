# SPDX-License-Identifier: Apache-2.0
"""soak.py RUN ASSET FOLDER MINUTES RATE_HZ: see scripts/soak.

The hand presses a slice every three seconds; every twentieth time it punctures the slice at a new place. cyclictest runs beside it
with the same scheduling class, priority and period."""
import json
import os
import pathlib
import platform
import subprocess
import sys
import time

HEIGHT_M = 0.12
PRIORITY = 80  # that of trocar-run
QUANTILES = {"p50": .5, "p99": .99, "p999": .999, "max": 1}


def scene(asset, duration_s, rate_Hz):
    """The scene and its number of punctures: presses of about 25 N, and punctures 3.6 mm apart."""
    frames, punctures, cycles = [{"t_s": 0, "tip_m": [0, 0, HEIGHT_M + 0.005]}], 0, int(duration_s // 3)
    step = max(1, -(-cycles // 900))  # at most 3600 key frames and 45 places
    for k in range(0, cycles, step):
        through = k // step % 20 == 19
        x, y = 0.0036 * (punctures % 9 - 4), 0.0036 * (punctures // 9 - 2)
        punctures += through
        frames += [{"t_s": 3 * k + t_s, "tip_m": [x, y, HEIGHT_M + dz]}
                   for t_s, dz in ((0.4, 0.005), (1.4, -0.02 if through else -0.0115), (1.9, -0.02 if through else -0.0115), (2.8, 0.005))]
    return {"schema": "trocar.scene/1", "name": "Soak", "asset": str(asset), "duration_s": duration_s, "rate_Hz": rate_Hz,
            "placement": {"anchor_mm": [81.5, 53.6]}, "slices": [{"index": 17, "z_m": HEIGHT_M}],
            "tissue": {"stiffness_N_per_m": 5000, "threshold_N": 35}, "tool": {"sides": 6, "radius_m": 0.0015},
            "hand": {"trajectory": frames}}, punctures


def quantiles_of(cyclictest):
    """us, from the histogram of cyclictest's JSON; 20000 stands for all above."""
    thread = cyclictest["thread"]["0"]
    found, seen = {"max": thread["max"]}, 0
    for us, count in sorted((int(us), count) for us, count in thread["histogram"].items()):
        seen += count
        for name, share in QUANTILES.items():
            if seen >= share * thread["cycles"]:
                found.setdefault(name, us)
    return {name: found.get(name, 20000) for name in QUANTILES}


def resident_MiB(pid):
    try:
        return next(int(line.split()[1]) / 1024 for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmRSS"))
    except (OSError, StopIteration):
        return None


def main():
    run, asset, folder = (pathlib.Path(word).resolve() for word in sys.argv[1:4])
    minutes, rate_Hz = map(float, sys.argv[4:6])
    folder.mkdir(parents=True, exist_ok=True)
    made, meant = scene(asset, 60 * minutes, rate_Hz)
    (folder / "scene.json").write_text(json.dumps(made))
    reference = subprocess.Popen(["cyclictest", "--quiet", "--mlockall", f"--priority={PRIORITY}", "--policy=fifo", "--threads=1",
                                  f"--interval={round(1e6 / rate_Hz)}", f"--duration={max(1, round(minutes * 60))}s", "--histofall=20000",
                                  f"--json={folder / 'cyclictest.json'}"], stdout=subprocess.DEVNULL)
    session = subprocess.Popen([run, folder / "scene.json", "--clock", "real", "--summary", folder / "summary.json", "--black-box", folder, "--quiet"])
    resident = []  # every half minute or 60 times
    while session.poll() is None:
        resident.append((time.monotonic() / 60, resident_MiB(session.pid)))
        time.sleep(min(30, minutes))
    if session.returncode != 0 or reference.wait(timeout=60) != 0:
        reference.kill()
        sys.exit(f"soak: trocar-run ended with {session.returncode}, cyclictest with {reference.returncode}")
    data = json.loads((folder / "summary.json").read_text())
    wake = quantiles_of(json.loads((folder / "cyclictest.json").read_text()))
    half = [(t, size) for t, size in resident[len(resident) // 2:] if size]
    growth = (half[-1][1] - half[0][1]) / (half[-1][0] - half[0][0]) if len(half) > 1 else 0

    print(f"{data['ticks']} ticks at {rate_Hz:g} Hz, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, kernel {platform.release()}; {data['realtime']}")
    for name, row in (("tick", data["tick_us"]), ("wake-up", data["wake_us"]), ("cyclictest", wake)):
        print(f"{name:12} us" + "".join(f"{key:>8} {row[key]:.1f}" for key in QUANTILES))
    ratio = data["wake_us"]["p999"] / max(wake["p999"], 1)
    verdicts = [("allocations in the loop", data["allocations_in_loop"], 0), ("memory's growth, KiB per minute", round(1024 * growth), 64),
                ("wake-up p99.9 over cyclictest's", round(ratio, 2), 1.2), ("tick p99.9, us", data["tick_us"]["p999"], 50),
                ("faults", len(data["faults"]), 0), ("punctures missing", meant - len(data["punctures"]), 0)]
    for what, value, most in verdicts:
        print(f"{'ok ' if value <= most else 'NOT'} {what}: {value} (at most {most})")
    (folder / "soak.json").write_text(json.dumps({**data, "cyclictest_us": wake, "growth_KiB_per_minute": 1024 * growth}, indent=1) + "\n")
    return 0 if all(value <= most for _, value, most in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
