# SPDX-License-Identifier: Apache-2.0
"""xray_ticks.py ASSET [ROUNDS]: do X-ray shots cost ticks? ASSET is the sample's; TROCAR_BUILD names the build.

Sessions of 10 s through the vertebra, in real time, started by a console, in turn: one in which nobody takes X-ray, and one with a
hundred shots. Prints the medians of the ticks' time and of the missed deadlines, with their ranges."""
import json
import pathlib
import shutil
import statistics
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "tests" / "e2e")]
from console_client import Console  # noqa: E402
from programs import PROGRAMS  # noqa: E402

SECONDS, SHOTS = 10, 100


def session(console, folder, shots):
    """(tick p50 in us, p99.9 in us, missed deadlines) of one session."""
    live = console.live()
    before = live.session if live.until(lambda l: l.hellos > 0) else ""
    status, answer = console.post("/api/start", {"scene": "vertebra.json", "duration_s": SECONDS})
    assert status == 200, answer
    assert live.until(lambda l: l.session not in (before, "") and l.values and l.value("t_s") > 0.2, 20)
    for _ in range(shots):
        assert console.post("/api/xray", {"take": "shot"})[0] == 200
        live.until(lambda _: False, 0.8 * SECONDS / SHOTS)  # it reads, or the console would close it
    assert live.until(lambda l: l.state() == "ended", 2 * SECONDS)
    summary = json.loads((folder / live.states[-1]["recording"]).parent.joinpath("session.summary.json").read_text(encoding="utf-8"))
    live.close()
    assert summary["xray"]["shots"] == shots, summary["xray"]
    return summary["tick_us"]["p50"], summary["tick_us"]["p999"], summary["missed_deadlines"]


def main():
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 6
    rows = {0: [], SHOTS: []}
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        shutil.copy(sys.argv[1], folder / "sample.glb")
        scene = json.loads((ROOT / "runtime" / "scenes" / "vertebra.json").read_text(encoding="utf-8"))
        (folder / "vertebra.json").write_text(json.dumps(scene | {"asset": "sample.glb"}), encoding="utf-8")
        console = Console(PROGRAMS / "trocar-console", folder, page=ROOT / "runtime" / "console" / "page")
        for i in range(rounds):
            for shots in sorted(rows, reverse=i % 2 == 1):
                rows[shots].append(session(console, folder, shots))
        console.stop()
    for shots, found in rows.items():
        columns = zip(("tick p50", "tick p99.9", "missed deadlines"), zip(*found))
        print(f"{shots:3} shots: " + "; ".join(f"{what} {statistics.median(of):.1f} ({min(of):.1f} to {max(of):.1f})" for what, of in columns))


if __name__ == "__main__":
    main()
