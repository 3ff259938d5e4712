# SPDX-License-Identifier: Apache-2.0
"""soak.py --run TROCAR_RUN --asset ASSET --out FOLDER --minutes M --rate HZ: see scripts/soak.

The hand presses a slice every three seconds; every twentieth time it punctures the slice at a new place.
cyclictest runs at the same time with the same scheduling class, priority and period, so that both are
woken by the same kernel under the same load."""
import argparse
import json
import os
import pathlib
import platform
import subprocess
import sys
import time

SLICE, HEIGHT_M, ANCHOR_MM = 17, 0.12, [81.5, 53.6]
CYCLE_S, PUNCTURE_EVERY = 3.0, 20
PRIORITY = 80  # that of trocar-run

WAKE_OVER_CYCLICTEST_MAX = 1.2
TICK_P999_MAX_US = 50
RSS_GROWTH_MAX_BYTES_PER_MINUTE = 64 * 1024  # more than the records of the punctures need


def scene(asset, duration_s, rate_hz):
    """The scene and its number of punctures: presses of about 25 N, and punctures at places 3.6 mm apart, one at each."""
    above, pressed, below = HEIGHT_M + 0.005, HEIGHT_M - 0.0115, HEIGHT_M - 0.02
    frames, cycles, punctures = [{"t_s": 0, "tip_m": [0, 0, above]}], int(duration_s // CYCLE_S), 0
    step = max(1, -(-cycles // 900))  # at most 3600 key frames and 45 places
    for k in range(0, cycles, step):
        t = k * CYCLE_S
        through = (k // step) % PUNCTURE_EVERY == PUNCTURE_EVERY - 1
        x, y = 0.0036 * (punctures % 9 - 4), 0.0036 * (punctures // 9 - 2)
        punctures += through
        depth = below if through else pressed
        if through or frames[-1]["tip_m"][:2] != [x, y]:
            frames.append({"t_s": t + 0.4, "tip_m": [x, y, above]})
        frames += [{"t_s": t + 1.4, "tip_m": [x, y, depth]}, {"t_s": t + 1.9, "tip_m": [x, y, depth]},
                   {"t_s": t + 2.8, "tip_m": [x, y, above]}]
    return {"schema": "trocar.scene/1", "name": "Soak", "asset": str(asset), "duration_s": duration_s, "rate_Hz": rate_hz,
            "placement": {"anchor_mm": ANCHOR_MM}, "slices": [{"index": SLICE, "z_m": HEIGHT_M}],
            "tissue": {"stiffness_N_per_m": 5000, "threshold_N": 35}, "tool": {"sides": 6, "radius_m": 0.0015},
            "hand": {"trajectory": frames}}, punctures


def quantile_us(histogram, share):
    """The smallest value that at least this share of the samples does not exceed."""
    wanted, seen = share * sum(histogram.values()), 0
    for value in sorted(histogram):
        seen += histogram[value]
        if seen >= wanted:
            return value
    return None


def start_cyclictest(minutes, rate_hz):
    command = ["cyclictest", "--quiet", "--mlockall", f"--priority={PRIORITY}", "--policy=fifo", "--threads=1",
               f"--interval={round(1e6 / rate_hz)}", f"--duration={max(1, round(minutes * 60))}s", "--histofall=20000"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def read_cyclictest(process):
    text, errors = process.communicate(timeout=60)
    histogram = {}
    for line in text.splitlines():
        words = line.split()
        if len(words) >= 2 and words[0].isdigit() and int(words[1]) > 0:
            histogram[int(words[0])] = int(words[1])
    if not histogram:
        raise SystemExit(f"soak: cyclictest gave no histogram: {errors.strip()}")
    overflows = next((int(line.split(":")[1].split()[0]) for line in text.splitlines() if line.startswith("# Histogram Overflows")), 0)
    if overflows:
        histogram[20000] = histogram.get(20000, 0) + overflows
    return {"samples": sum(histogram.values()), "over_20_ms": overflows,
            **{name: quantile_us(histogram, share) for name, share in (("p50", .5), ("p99", .99), ("p999", .999))}, "max": max(histogram)}


def resident_bytes(pid):
    try:
        for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return None


def watch(process, seconds):
    """Resident memory while the process runs, as [[s, bytes], ...]."""
    seen, start = [], time.monotonic()
    while process.poll() is None:
        if time.monotonic() - start > 2 * seconds + 120:
            process.terminate()
            raise SystemExit("soak: trocar-run does not end")
        size = resident_bytes(process.pid)
        if size:
            seen.append([time.monotonic() - start, size])
        time.sleep(min(1.0, seconds / 60))
    return seen


def growth_per_minute(seen):
    """Bytes per minute: the slope of a line fitted to the second half."""
    half = seen[len(seen) // 2:]
    n = len(half)
    if n < 4:
        return 0.0
    t, y = [p[0] / 60 for p in half], [p[1] for p in half]
    mt, my = sum(t) / n, sum(y) / n
    return sum((a - mt) * (b - my) for a, b in zip(t, y)) / max(sum((a - mt) ** 2 for a in t), 1e-12)


def measure(given):
    given.out.mkdir(parents=True, exist_ok=True)
    made, punctures = scene(given.asset.resolve(), given.minutes * 60, given.rate)
    file, summary = given.out / "scene.json", given.out / "summary.json"
    file.write_text(json.dumps(made))
    load = os.getloadavg()[0]
    cyclictest = start_cyclictest(given.minutes, given.rate)
    run = subprocess.Popen([given.run, file, "--clock", "real", "--summary", summary, "--black-box", given.out, "--quiet"])
    try:
        memory = watch(run, given.minutes * 60)
        if run.returncode != 0:
            raise SystemExit(f"soak: trocar-run ended with {run.returncode}")
        reference = read_cyclictest(cyclictest)
    finally:
        cyclictest.kill()
    found = json.loads(summary.read_text())
    return {
        "minutes": given.minutes, "rate_Hz": given.rate, "kernel": platform.release(), "cores_count": len(os.sched_getaffinity(0)),
        "load_average_at_start": load, "load_average_at_end": os.getloadavg()[0], "realtime": found["realtime"],
        "ticks": found["ticks"], "allocations_in_loop": found["allocations_in_loop"], "page_faults_in_loop": found["page_faults_in_loop"],
        "missed_deadlines": found["missed_deadlines"], "missed_deadlines_in_row_max": found["missed_deadlines_in_row_max"],
        "tick_us": found["tick_us"], "wake_us": found["wake_us"], "cyclictest_wake_us": reference,
        "wake_p999_over_cyclictest_ratio": found["wake_us"]["p999"] / max(reference["p999"], 1),
        "punctures": len(found["punctures"]), "punctures_meant": punctures, "faults": found["faults"],
        "resident_bytes_at_end": memory[-1][1] if memory else None, "resident_growth_bytes_per_minute": growth_per_minute(memory),
    }


def verdicts(data):
    return [
        ("allocations in the loop", data["allocations_in_loop"], "0", data["allocations_in_loop"] == 0),
        ("resident memory, growth", f"{data['resident_growth_bytes_per_minute'] / 1024:.1f} KiB per minute",
         f"<= {RSS_GROWTH_MAX_BYTES_PER_MINUTE // 1024}", data["resident_growth_bytes_per_minute"] <= RSS_GROWTH_MAX_BYTES_PER_MINUTE),
        ("wake-up p99.9 over that of cyclictest", f"{data['wake_p999_over_cyclictest_ratio']:.2f}", f"<= {WAKE_OVER_CYCLICTEST_MAX}",
         data["wake_p999_over_cyclictest_ratio"] <= WAKE_OVER_CYCLICTEST_MAX),
        ("tick p99.9", f"{data['tick_us']['p999']:.1f} us", f"<= {TICK_P999_MAX_US} us", data["tick_us"]["p999"] <= TICK_P999_MAX_US),
        ("faults", len(data["faults"]), "0", not data["faults"]),
        ("punctures", data["punctures"], data["punctures_meant"], data["punctures"] == data["punctures_meant"]),
    ]


def main():
    parser = argparse.ArgumentParser(usage=argparse.SUPPRESS)
    for name in ("run", "asset", "out"):
        parser.add_argument(f"--{name}", type=pathlib.Path, required=True)
    parser.add_argument("--minutes", type=float, required=True)
    parser.add_argument("--rate", type=float, required=True)
    given = parser.parse_args()
    if not (0.2 <= given.minutes <= 1440 and 100 <= given.rate <= 8000):
        print("soak: --minutes must be within 0.2 and 1440, --rate within 100 and 8000", file=sys.stderr)
        return 2
    data = measure(given)
    (given.out / "soak.json").write_text(json.dumps(data, indent=1) + "\n")
    realtime = data["realtime"]
    print(f"{data['ticks']} ticks at {data['rate_Hz']:g} Hz on {data['cores_count']} cores, load {data['load_average_at_start']:.1f} to "
          f"{data['load_average_at_end']:.1f}; {realtime['scheduling']} on cpus {realtime['cpus']}, memory "
          f"{'locked' if realtime['memory_locked'] else 'not locked'}, kernel {data['kernel']}, "
          f"{'realtime' if realtime['kernel_is_realtime'] else 'not realtime'}{'; ' + realtime['note'] if realtime['note'] else ''}")
    print(f"{'us':14}{'p50':>10}{'p99':>10}{'p99.9':>10}{'max':>10}")
    for name, row in (("tick", data["tick_us"]), ("wake-up", data["wake_us"]), ("cyclictest", data["cyclictest_wake_us"])):
        print(f"{name:14}" + "".join(f"{row[key]:10.1f}" for key in ("p50", "p99", "p999", "max")))
    print(f"missed deadlines {data['missed_deadlines']}, most in a row {data['missed_deadlines_in_row_max']}, page faults {data['page_faults_in_loop']}, "
          f"resident {(data['resident_bytes_at_end'] or 0) / 2**20:.1f} MiB")
    for what, value, bound, good in verdicts(data):
        print(f"{'ok  ' if good else 'NOT '} {what}: {value} (bound {bound})")
    return 0 if all(good for *_, good in verdicts(data)) else 1


if __name__ == "__main__":
    sys.exit(main())
