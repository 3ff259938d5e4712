# SPDX-License-Identifier: Apache-2.0
"""The hand lifts the plate to the end of its reach, which is a fault, and
comes back. Exit codes, the black box, no recovery, automatic recovery, and the replay; a full disk, and output that cannot be written. (Recovery
by SIGUSR1: stops_test.py; recordings of killed sessions: console_server_test.py.)"""
import json
import os
import pathlib
import resource
import subprocess

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
    # Standard output that cannot be written is an error, except for a closed pipe.
    with open("/dev/full", "w") as nowhere:
        printed = subprocess.run([trocar_run, "check", scene], stdout=nowhere, stderr=subprocess.PIPE, text=True, check=False)
    assert printed.returncode == 4 and "standard output could not be written" in printed.stderr, f"a full standard output: {printed.returncode}, {printed.stderr!r}"
    process = subprocess.Popen([trocar_run, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.close()
    assert process.wait() == 0, f"a closed pipe: {process.returncode}, {process.stderr.read()!r}"
    check_closed_folder(trocar_run, scene, work)
