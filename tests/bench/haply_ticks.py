# SPDX-License-Identifier: Apache-2.0
"""haply_ticks.py ASSET [ROUNDS]: does a session over a socket compute its ticks as fast as one with the device in its own process?
ASSET is the sample's; TROCAR_BUILD names the build.

Three sessions in turn, in real time and with the same motion of the hand through the vertebra, a round of 27 s:

  inproc   the device is simulated in the process, with nothing else on the machine
  haply    the device is the stand-in for the Haply service, over a WebSocket
  beside   inproc, while another session with the stand-in runs on the same processors

`beside` has the cost that a second program and its messages bring to every process of the machine, such as cold caches and
interrupts; what `haply` has above it would be the loop's own. `device` is the part of a tick that reads and writes the device:
if the loop waited for the socket, it would hold a round trip."""
import contextlib
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))
from haply_stand_in import StandIn  # noqa: E402
from programs import PROGRAMS  # noqa: E402

SCENE = ROOT / "runtime" / "scenes" / "vertebra.json"
DESCRIPTION = ROOT / "runtime" / "device" / "haply_inverse3.json"
SECONDS = 8.4
LOAD_S = SECONDS + 3.6  # starts before the session beside it, and ends after it
MIDDLE_M = (0.0, -0.12, 0.15)  # of the arm's workspace
KINDS = ("inproc", "haply", "beside")
FIGURES = ("tick p50", "tick p99.9", "device p50", "device p99.9")


def write_path(file):
    """The scene's motion, as keyframes of a hand that holds the stand-in's handle."""
    keys = json.loads(SCENE.read_text(encoding="utf-8"))["hand"]["trajectory"]
    middle = [(min(axis) + max(axis)) / 2 for axis in zip(*(key["tip_m"] for key in keys))]
    path = [{"t_s": key["t_s"], "position_m": [m + tip - at for m, tip, at in zip(MIDDLE_M, key["tip_m"], middle)]} for key in keys]
    file.write_text(json.dumps(path), encoding="utf-8")
    return file


def command(asset, folder, name, seconds, *device):
    return [PROGRAMS / "trocar-run", SCENE, "--asset", asset, "--device", *device, "--clock", "real", "--duration", str(seconds), "--quiet",
            "--summary", folder / f"{name}.json", "--black-box", folder]


def summary_of(folder, name):
    return json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))


@contextlib.contextmanager
def stand_in(path):
    with StandIn("--protocol", "3.1", "--path", path, "--hand-stiffness", 1500, "--hand-damping", 30) as service:
        yield f"haply:127.0.0.1:{service.port}", "--late-ticks-in-row", "0"


def session(kind, asset, path, folder):
    """The figures of one session in us. One that ended early, because the machine stood still, is repeated."""
    in_process = command(asset, folder, kind, SECONDS, "inproc", "--device-description", DESCRIPTION)
    for _ in range(5):
        if kind == "inproc":
            done = subprocess.run(in_process, check=False)
        elif kind == "haply":
            with stand_in(path) as device:
                done = subprocess.run(command(asset, folder, kind, SECONDS, *device), check=False)
        else:
            with stand_in(path) as device, subprocess.Popen(command(asset, folder, "load", LOAD_S, *device)) as load:
                time.sleep(2)
                done = subprocess.run(in_process, check=False)
                if load.poll() is not None:
                    continue
        if done.returncode == 0:
            found = summary_of(folder, kind)
            return [found[f"{part}_us"][quantile] for part in ("tick", "device") for quantile in ("p50", "p999")]
    raise SystemExit(f"{kind}: five sessions ended early")


def main():
    asset = pathlib.Path(sys.argv[1])
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 6
    rows = {kind: [] for kind in KINDS}
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        path = write_path(folder / "path.json")
        for i in range(rounds):
            for kind in KINDS if i % 2 else reversed(KINDS):
                rows[kind].append(session(kind, asset, path, folder))
    print(f"medians of {rounds} rounds in us (smallest to largest)")
    for kind, found in rows.items():
        columns = zip(FIGURES, zip(*found))
        print(f"{kind:8}" + "   ".join(f"{what} {statistics.median(of):.1f} ({min(of):.1f} to {max(of):.1f})" for what, of in columns))
    tail = {kind: statistics.median(row[1] for row in found) for kind, found in rows.items()}
    print(f"tick p99.9, haply over inproc: {tail['haply'] / tail['inproc']:.2f}; haply over beside: {tail['haply'] / tail['beside']:.2f}")


if __name__ == "__main__":
    main()
