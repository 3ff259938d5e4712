# SPDX-License-Identifier: Apache-2.0
"""Trocar-run and trocar-device-sim as two processes.

 1. The paper's two experiments in virtual time (lock-step): twice the same bytes, the same bytes as
    with the device in the process, 35 N within 2 % on the simulated hand, with both models.
 2. A host begins a session only after its preparation, however long that takes.
 3. In lock-step a drive ends some seconds after its last host has died, but not in a pause.
Injected faults: fault_campaign_test.py. Hosts of another implementation: pose_drive_test.py.
"""
import json
import signal
import socket
import subprocess
import time

import device_link as link
import pytest
from exported import rows_of
from programs import COUNTED_RUN, NO_ALLOCATIONS, run

FORCE_N, SHARE = 35.0, 0.02
STALLS = {"no_data", "link_lost", "deadline_missed"}


class Simulator:
    """A running trocar-device-sim, ended on leaving the context."""

    def __init__(self, programs, work, *arguments):
        self.summary_file, self.key_file = work / "sim.json", work / "link.key"
        self.summary_file.unlink(missing_ok=True)
        command = [programs / "trocar-device-sim", "--listen", "127.0.0.1:0", "--key-file", self.key_file,
                   "--summary", self.summary_file, "--quiet", *arguments]
        self.process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE, text=True)
        line = self.process.stdout.readline()
        assert line.startswith("ready on "), f"no simulator: {self.process.communicate()}"
        self.address = line.split()[2]

    def __enter__(self):
        return self

    def end(self, how=signal.SIGINT):
        """Its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        self.process.communicate(timeout=30)
        return self.process.returncode

    def __exit__(self, *_):
        self.end(signal.SIGTERM)

    def summary(self):
        code = self.end()
        assert code == 0, f"the simulator ended with {code}"
        return json.loads(self.summary_file.read_text())

    def link(self):
        """The options with which trocar-run uses it."""
        return "--device", f"udp:{self.address}", "--key-file", self.key_file

    def session(self, trocar_run, scene, asset, *arguments):
        """(exit code, stderr) of trocar-run on it."""
        command = [trocar_run, scene, "--asset", asset, *self.link(), "--quiet", *arguments]
        done = run(*command, expect=None)
        return done.returncode, done.stderr

    def socket(self, timeout_s=0.5):
        host, port = self.address.split(":")
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.connect((host, int(port)))
        made.settimeout(timeout_s)
        return made

    def key(self):
        return bytes.fromhex(self.key_file.read_text())


def check_hand(name, drive_report, punctures, sheets):
    peaks = [peak["force_N"] for peak in drive_report["hand_peaks"]]
    assert len(peaks) == sheets, f"{name}: {len(peaks)} peaks of the hand's force for {sheets} sheets"
    for peak in peaks:
        assert abs(peak - FORCE_N) <= SHARE * FORCE_N, f"{name}: a peak of {peak} N on the hand"
    assert abs(drive_report["hand_force_max_N"] - FORCE_N) <= SHARE * FORCE_N, f"{name}: largest force on the hand {drive_report['hand_force_max_N']} N"
    assert len(punctures) == sheets, f"{name}: {len(punctures)} punctures"
    print(f"{name}: on the hand {', '.join(f'{p:.3f} N' for p in peaks)}")


def prompt_device(source, work):
    """The built-in device, stating that it has no delay: in lock-step it has none, and by default a link counts a tick."""
    device = json.loads((source / "formats/session/four_legs.json").read_text())
    (work / "prompt.json").write_text(json.dumps({**device, "delay_s": 0}))
    return work / "prompt.json"


def test_experiments(source, programs, asset, work):
    trocar_run = programs / COUNTED_RUN
    prompt = prompt_device(source, work)
    for name, sheets in (("one_slice", 1), ("three_slices", 3)):
        scene = source / "runtime" / "scenes" / f"{name}.json"
        inside = work / f"{name}.inproc.csv"
        run(trocar_run, scene, "--asset", asset, "--clock", "virtual", "--quiet", "--record", inside, "--device-description", prompt)
        for model in ("light", "full"):
            recordings = []
            for repeat in (1, 2) if (name, model) != ("three_slices", "full") else (1,):
                record, summary = work / f"{name}_{model}_{repeat}.csv", work / "run.json"
                with Simulator(programs, work, scene, "--clock", "lock-step", "--model", model) as simulator:
                    code, stderr = simulator.session(trocar_run, scene, asset, "--clock", "virtual",
                                                     "--record", record, "--summary", summary, "--device-description", prompt)
                    assert code == 0, f"{name} {model} in lock-step ended with {code}: {stderr}"
                    drive_report = simulator.summary()
                recordings.append(record.read_bytes())
                report = json.loads(summary.read_text())
                assert report["allocations_in_loop"] == NO_ALLOCATIONS, f"{name}: {report['allocations_in_loop']} allocations"
                if repeat == 1:
                    check_hand(f"{name}, {model} model, lock-step", drive_report, report["punctures"], sheets)
            assert recordings[0] == recordings[-1], f"{name} {model}: two runs differ"
            if model == "light":
                assert recordings[0] == inside.read_bytes(), f"{name}: differs from the device in the process"


def test_slow_preparation(source, programs, asset, work):
    """A host whose preparation takes longer than a drive keeps a session without commands (1 s)."""
    scene = json.loads((source / "runtime" / "scenes" / "three_slices.json").read_text())
    slices = [21, 19, 17, 15, 13]
    scene["force_law"] = {"kind": "network", "solver": "auto", "reach_m": 0.005, "error_bound": 0.01}
    scene["tool"] = {"sides": 24, "radius_m": 0.003}
    scene["slices"] = [{"index": index, "z_m": 0.19 - 0.02 * i, "tissue": str(index)} for i, index in enumerate(slices)]
    scene["tissues"] = [{"name": str(index), "stiffness_N_per_m": 4000 + index, "threshold_N": 35} for index in slices]
    file, record = work / "slow.json", work / "slow.csv"
    file.write_text(json.dumps(scene))
    begun = time.monotonic()
    run(programs / "trocar-run", file, "--asset", asset, "--clock", "virtual", "--duration", "0.01", "--quiet")
    print(f"slow preparation: {time.monotonic() - begun:.2f} s")
    with Simulator(programs, work, file) as simulator:
        code, stderr = simulator.session(programs / "trocar-run", file, asset, "--duration", "0.3", "--record", record)
    rows = rows_of(record)
    assert any(row["device_read"] == "ok" for row in rows), f"no data after a long preparation: {code} {stderr}"


def test_host_that_dies(source, programs, work):
    scene = source / "runtime" / "scenes" / "one_slice.json"
    with Simulator(programs, work, scene, "--clock", "lock-step", "--sessions", "1") as simulator:
        host = link.Host(simulator.socket(), simulator.key())
        host.command(link.HOLD)
        assert host.state() is not None
        host.socket.close()  # without a stop
        assert simulator.process.wait(timeout=120) == 0, "it waits for its host for ever"
        assert json.loads(simulator.summary_file.read_text())["sessions"] == 1


def test_host_that_pauses(source, programs, work):
    """In lock-step the host of a paused session sends nothing, however long the pause is."""
    scene = source / "runtime" / "scenes" / "one_slice.json"
    with Simulator(programs, work, scene, "--clock", "lock-step", "--sessions", "1") as simulator:
        host = link.Host(simulator.socket(), simulator.key())
        host.command(link.HOLD)
        assert host.state() is not None
        with pytest.raises(subprocess.TimeoutExpired):
            simulator.process.wait(timeout=12)
        host.command(link.HOLD)
        assert host.state() is not None, "not served after the pause"
        host.command(link.STOP)
        assert simulator.process.wait(timeout=120) == 0
