# SPDX-License-Identifier: Apache-2.0
"""The hand lifts the plate to the end of its reach, which is a fault, and
comes back. Exit codes, the black box, no recovery, automatic recovery, recovery by SIGUSR1, and the replay."""
import json
import os
import pathlib
import resource
import signal
import subprocess
import time

from programs import run


def scene_of(source, asset):
    scene = json.loads((source / "runtime" / "scenes" / "one_slice.json").read_text())
    tip = [0.148, 0.148, 0.245, 0.148, 0.148, 0.1]
    at = [0, 0.1, 0.8, 1.4, 2.2, 4.5]
    scene.update(asset=str(asset), duration_s=4.8)
    scene["hand"] = {"trajectory": [{"t_s": t, "tip_m": [0, 0, z]} for t, z in zip(at, tip)]}
    return scene


def limited(*command, size=5_000):
    """The finished process, with files limited to so many bytes."""
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)))


def boxes(folder):
    return sorted(folder.glob("black_box_*.csv"))


def check_closed_folder(trocar_run, scene, work):
    """In a folder that cannot be written to, a session runs, and says that a black box would go to the folder for temporary files."""
    closed = work / "closed"
    closed.mkdir(exist_ok=True)
    closed.chmod(0o555)
    # Root may write everywhere, so the session runs as nobody, if nobody can read program and scene.
    as_user = ["setpriv", "--reuid", "65534", "--clear-groups"] if os.geteuid() == 0 else []
    if subprocess.run([*as_user, trocar_run, "check", scene.resolve()], cwd="/", capture_output=True, check=False).returncode != 0:
        return
    done = subprocess.run([*as_user, trocar_run, scene.resolve(), "--clock", "virtual", "--duration", "0.01"], cwd=closed, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0 and "note: the current folder cannot be written to" in done.stderr, f"no current folder: {done}"
    # A new scene is no session, and has no black box.
    opened = work / "opened"
    opened.mkdir(exist_ok=True)
    opened.chmod(0o777)
    done = subprocess.run([*as_user, trocar_run, "new-scene", (work / "sample.glb").resolve(), "-o", opened.resolve() / "scene.json"],
                          cwd=closed, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == "", f"a new scene: {done}"


def test_recovery(source, programs, asset, work):
    trocar_run = programs / "trocar-run"
    scene = work / "scene.json"
    scene.write_text(json.dumps(scene_of(source, asset)))

    # No recovery: exit code 5, with a recording and a black box.
    never = work / "never"
    never.mkdir()
    done = run(trocar_run, scene, "--clock", "virtual", "--record", never / "r.csv", "--summary", never / "s.json", "--quiet", expect=5)
    assert "joint_limit" in done.stderr, f"the fault is not named: {done.stderr!r}"
    summary = json.loads((never / "s.json").read_text())
    fault, = summary["faults"]
    assert fault["fault"] == "joint_limit" and fault["recovered_t_s"] is None, fault
    assert 0 <= fault["torques_zero_t_s"] - fault["t_s"] <= 0.005, f"torques were not zero in time: {fault}"
    box, = boxes(never)
    assert box.name == pathlib.Path(fault["black_box"]).name and "_joint_limit" in box.name, f"{box} or {fault}"
    recording = (never / "r.csv").read_bytes()
    assert recording == box.read_bytes(), "the black box of a session of less than 4 s is not its recording"
    assert len(recording.splitlines()) == summary["ticks"] + 1, "rows are missing"

    # A session that ends at its fault, or before torques are zero: its black box ends with its last row.
    tick_s = 1 / summary["rate_Hz"]
    for ticks in range(1, 8):
        cut = work / f"cut_{ticks}"
        cut.mkdir()
        run(trocar_run, scene, "--clock", "virtual", "--duration", round(fault["t_s"] + ticks * tick_s, 9), "--record", cut / "r.csv",
            "--summary", cut / "s.json", "--quiet", expect=5)
        event, = json.loads((cut / "s.json").read_text())["faults"]
        rows = (cut / "r.csv").read_bytes().splitlines()
        assert event["fault"] == "joint_limit" and event["t_s"] == fault["t_s"], f"{ticks} ticks: {event}"
        zero = None if fault["torques_zero_t_s"] > fault["t_s"] + (ticks - 0.5) * tick_s else fault["torques_zero_t_s"]
        assert event["torques_zero_t_s"] == zero, f"{ticks} ticks: {event}, zero at {zero}"
        whole = min(round(fault["t_s"] / tick_s) + ticks, summary["ticks"]) + 1  # without a recovery request it ends once torques are zero
        assert len(rows) == whole, f"{ticks} ticks: {len(rows)} rows, not {whole}"
        last = len(rows) if zero is None else round(zero / tick_s) + 2
        box, = boxes(cut)
        assert box.name == pathlib.Path(event["black_box"]).name and box.read_bytes().splitlines() == rows[:last], f"{ticks} ticks: {box} has other rows"

    # Automatic recovery: the session continues, and the tool punctures the slice.
    auto = work / "auto"
    auto.mkdir()
    run(trocar_run, scene, "--clock", "virtual", "--recover", "auto", "--record", auto / "r.csv", "--summary", auto / "s.json", "--quiet")
    summary = json.loads((auto / "s.json").read_text())
    fault, = summary["faults"]
    assert fault["recovered_t_s"] is not None and fault["recovered_t_s"] > fault["t_s"] + 0.25, fault
    assert len(summary["punctures"]) == 1 and abs(summary["punctures"][0]["tip_N"] - 35) < 0.2, summary["punctures"]
    assert len(boxes(auto)) == 1, boxes(auto)
    replayed = run(trocar_run, "replay", scene, auto / "r.csv", "--recover", "auto", "--record", auto / "again.csv")
    assert "identical" in replayed.stdout, replayed.stdout
    assert (auto / "r.csv").read_bytes() == (auto / "again.csv").read_bytes(), "the replay of a recovery differs"
    assert len(boxes(auto)) == 1, "a replay wrote a black box"

    # Recovery by the operator, in real time; the black box goes to the working directory by default.
    signalled = work / "signalled"
    signalled.mkdir()
    process = subprocess.Popen([trocar_run, scene, "--clock", "real", "--rate", "500", "--recover", "signal", "--summary", "s.json", "--quiet"],
                               cwd=signalled, stderr=subprocess.PIPE, text=True)
    time.sleep(2.2)
    process.send_signal(signal.SIGUSR1)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, f"{process.returncode}: {errors}"
    summary = json.loads((signalled / "s.json").read_text())
    fault, = summary["faults"]
    assert fault["recovered_t_s"] is not None, fault
    assert summary["ticks"] == 2400 and len(boxes(signalled)) == 1, summary["ticks"]
    assert "scheduling" in summary["realtime"] and isinstance(summary["realtime"]["kernel_is_realtime"], bool), summary["realtime"]
    assert sum(count for _, count in summary["tick_histogram_us"]) == summary["tick_us"]["samples"], "the histogram does not add up"
    device, tick = summary["device_us"], summary["tick_us"]
    assert device["samples"] == tick["samples"] and 0 < device["max"] <= tick["max"], (device, tick)

    # A full disk: the files that fit are written, and the exit code is a fault's before that of the files.
    full = work / "full"
    full.mkdir()
    one_slice = source / "runtime" / "scenes" / "one_slice.json"
    outputs = ("--asset", asset, "--clock", "virtual", "--meshes", full / "m.json", "--summary", full / "s.json", "--quiet")
    for asked, more, code, fault in ((scene, ("--black-box", full), 5, "joint_limit"), (one_slice, ("--record", full / "r.csv"), 4, "recording_failed")):
        done = limited(trocar_run, asked, *more, *outputs)
        assert done.returncode == code, f"a full disk: {done.returncode}, not {code}: {done.stderr!r}"
        assert f"fault {fault} at" in done.stderr and "m.json: File too large" in done.stderr, f"a full disk: {done.stderr!r}"
        assert ("joint_limit" in done.stderr.rpartition("trocar-run: ")[2]) == (code == 5), f"a full disk: {done.stderr!r}"
        assert "-USR1" not in done.stderr and "link_lost" not in done.stderr, f"a full disk: {done.stderr!r}"
        summary = json.loads((full / "s.json").read_text())
        assert [each["fault"] for each in summary["faults"]] == [fault], f"a full disk: {summary['faults']}"
        assert summary["end"] == ("fault" if code == 5 else "interrupted") and not boxes(full), f"a full disk: {summary['end']}, {boxes(full)}"
    # What was recorded is kept, and said to be; the files that must be whole are not there.
    kept = full / "r.csv.partial"
    text = kept.read_bytes()
    assert text.endswith(b"\n") and f"r.csv: File too large; the first {text.count(bytes([10])) - 1} rows are in {kept}" in done.stderr, f"a full disk: {done.stderr!r}"
    left = sorted(file.name for file in full.iterdir() if not file.name.startswith("black_box_"))
    assert left == ["r.csv.partial", "s.json"], f"a full disk: {left}"
    # The disk is full only after a fault, with the last rows: the session keeps the fault, and so does its exit code.
    late = work / "full_late"
    late.mkdir()
    done = limited(trocar_run, scene, "--clock", "virtual", "--record", late / "r.csv", "--summary", late / "s.json", "--black-box", late,
                   "--quiet", size=len(recording) - 100)
    assert done.returncode == 5 and "joint_limit" in done.stderr and "r.csv: File too large; the first " in done.stderr, f"full after a fault: {done}"
    assert [each["fault"] for each in json.loads((late / "s.json").read_text())["faults"]] == ["joint_limit"], f"full after a fault: {done}"
    # The next recording of that name moves them aside.
    run(trocar_run, one_slice, "--asset", asset, "--clock", "virtual", "--record", full / "r.csv", "--quiet")
    assert (full / "r.csv.partial.1").read_bytes() == text and (full / "r.csv").exists() and not kept.exists(), "kept rows are not moved aside"

    # A killed session: its rows are under the documented name.
    killed = work / "killed"
    killed.mkdir()
    def rows():
        """The whole rows of the file so far."""
        return kept.read_bytes().rpartition(b"\n")[0].split(b"\n")[1:] if kept.exists() else []

    began = time.monotonic()
    process = subprocess.Popen([trocar_run, source / "runtime" / "scenes" / "one_slice.json", "--asset", asset, "--rate", "8000", "--duration", "60",
                                "--record", killed / "r.csv", "--quiet"], cwd=killed, stderr=subprocess.DEVNULL)
    kept = killed / "r.csv.partial"
    while process.poll() is None and not (seen := rows()):
        time.sleep(0.01)
    seen_at, seen_s = time.monotonic(), float(seen[-1].split(b",")[0])
    time.sleep(1.5)
    process.kill()
    killed_at = time.monotonic()
    process.wait()
    assert [file.name for file in killed.iterdir()] == [kept.name], f"a killed session: {list(killed.iterdir())}"
    last_s, at_least_s = float(rows()[-1].split(b",")[0]), seen_s + killed_at - seen_at
    assert at_least_s - 0.2 <= last_s <= killed_at - began, f"a killed session has {last_s} s of at least {at_least_s} s"

    # Standard output that cannot be written is an error, except for a closed pipe. A replay reports differing torques.
    with open("/dev/full", "w") as nowhere:
        printed = subprocess.run([trocar_run, "check", scene], stdout=nowhere, stderr=subprocess.PIPE, text=True, check=False)
    assert printed.returncode == 4 and "standard output could not be written" in printed.stderr, f"a full standard output: {printed.returncode}, {printed.stderr!r}"
    process = subprocess.Popen([trocar_run, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.close()
    assert process.wait() == 0, f"a closed pipe: {process.returncode}, {process.stderr.read()!r}"
    weaker = work / "weaker.json"
    weaker.write_text(json.dumps({**scene_of(source, asset), "tissue": {"stiffness_N_per_m": 5000, "threshold_N": 20}}))
    replayed = run(trocar_run, "replay", weaker, auto / "r.csv", "--recover", "auto", "--quiet", expect=3)
    assert "was recorded with other inputs: the scene" in replayed.stderr, f"a replay that differs: {replayed.stderr!r}"

    check_closed_folder(trocar_run, scene, work)
