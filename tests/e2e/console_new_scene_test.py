# SPDX-License-Identifier: Apache-2.0
"""POST /api/new_scene makes a scene in the console's folder and checks it. Who may do it, what is refused, and that nothing else of the folder
changes. (Scenes of an asset, and ways that no needle can take: console/drive_new_scene.mjs.)"""
import json
import os
import shutil
import time

import numpy as np
import pytest

from chromium_page import PAGE
from console_client import Console, container
from console_server_test import CONSOLE, make_folder
from e2e import check
from programs import PROGRAMS, WORK, run

WITHIN_s = 120
PATH = "/api/new_scene"


def result(console):
    states, end = [], time.monotonic() + WITHIN_s
    while time.monotonic() < end:
        told = console.get(PATH)[1]
        states.append(told["state"])
        if told["state"] in ("ended", "none"):
            return told, states
        time.sleep(0.02)
    check(False, f"no scene within {WITHIN_s} s: {told}")
    return told, states


def files_of(folder):
    return {str(file.relative_to(folder)): file.stat().st_mtime_ns for file in folder.rglob("*") if file.is_file() and "sessions" not in file.parts}


@pytest.fixture(name="folder", scope="module")
def folder_of_scenes():
    return make_folder()


@pytest.fixture(name="console", scope="module")
def started_console(folder):
    """At its end it makes another scene."""
    console = Console(CONSOLE, folder, page=PAGE)
    yield console
    check(console.post(PATH, {"asset": "sample.glb", "name": "ended"})[0] == 200, "a scene when the console ends")
    check(console.stop() == 0 and not list(folder.glob("*.making")) and not (folder / "ended.json").exists(), "the console did not end as it should")


@pytest.fixture(name="points", scope="module")
def entry_and_target(console):
    """Points of the bone of vertebra.json: above its thickest part, in the patient's frame."""
    bone, _ = container(console.request("GET", "/api/bone?scene=scenes/vertebra.json", raw=True)[1])
    rows = np.array(bone["lps_mm_of_device"])
    top = max(each["z_m"] for each in bone["slices"])
    place = lambda x, y, z: (rows @ [x, y, z, 1]).tolist()
    return place(0, 0, top), place(0.003, 0.002, top - 0.02)


def test_refusals(console, folder, points):
    entry, _ = points
    os.symlink("/tmp/nothing", folder / "link.json")
    check(console.post(PATH, {"asset": "sample.glb", "name": "link"})[0] == 409, "a scene in place of a link")
    (folder / "wrong.json").write_text('{"schema": "trocar.scene/1", "nothing": 1}')
    good = {"scene": "scenes/vertebra.json", "name": "new", "entry_mm": entry}
    for change, status in (({"name": "a/b"}, 400), ({"name": "../up"}, 400), ({"name": ""}, 400), ({"name": "x" * 33}, 400), ({"name": 3}, 400), ({"entry_mm": [1, 2]}, 400),
                           ({"entry_mm": [1, 2, "3"]}, 400), ({"entry_mm": [1, 2, 1e9]}, 400), ({"target_mm": None}, 400), ({"live_hand": 1}, 400), ({"device": "udp:127.0.0.1:1"}, 400),
                           ({"live_hand": True, "device": "sim"}, 400), ({"scene": "wrong.json"}, 400), ({"scene": "none.json"}, 404), ({"scene": "../x.json"}, 404), ({"asset": "none.glb"}, 404), ({"more": 1}, 400)):
        told = console.post(PATH, {**good, **change})
        check(told[0] == status and told[1]["error"], f"{change}: {told}")
    without = {key: value for key, value in good.items() if key != "entry_mm"}
    check(console.post(PATH, {**without, "target_mm": entry})[0] == 400, "a target without an entry")
    for keys, status in (({"token": console.view}, 403), ({"token": None}, 401)):
        check(console.post(PATH, good, **keys)[0] == status, f"{keys} makes a scene")
    check(console.get(PATH, token=console.view)[0] == 200 and console.request("PUT", PATH, good)[0] == 405, "who may ask")
    check(console.get(PATH)[1] == {"state": "none"}, "a refused request made something")


def test_made(console, folder, points):
    entry, target = points
    before = files_of(folder)
    body = {"scene": "scenes/vertebra.json", "name": "to_target", "entry_mm": entry, "target_mm": target, "live_hand": True}
    check(console.post(PATH, body) == (200, {"ok": True}), "the start")
    for path, other in ((PATH, {**body, "name": "second"}), ("/api/start", {"scene": "scenes/one_slice.json"})):
        status, answer = console.post(path, other)
        check(status == 409 and "a scene is being made" in answer["error"], f"{path} meanwhile: {status} {answer}")
    told, states = result(console)
    check(told["scene"] == "to_target.json" and told["end"] == "exit code 0" and told["name"] == "to_target" and "checking" in states, f"{told}, {set(states)}")
    check(told["warnings"] == [] and told["check"].startswith("scene") and "the needle enters at" in told["text"], f"{told}")
    check(not any(part in json.dumps(told) for part in (str(folder), str(WORK), WORK.name)), f"a path is told: {told}")
    after = files_of(folder)
    check({name: after[name] for name in before} == before and set(after) - set(before) == {"to_target.json"}, f"{set(after) - set(before)}")
    scene = json.loads((folder / "to_target.json").read_text())
    check(scene["asset"] == "sample.glb" and scene["hand"]["live"] and set(scene["goals"]) == {"target", "line"}, f"{scene['asset']}, {scene['goals']}")
    again = WORK / "again.json"
    words = [",".join(f"{x:.3f}" for x in point) for point in (entry, target)]
    run(PROGRAMS / "trocar-run", "new-scene", folder / "sample.glb", "-o", again, "--entry", words[0], "--target", words[1], "--live-hand", "--quiet")
    check({**json.loads(again.read_text()), "asset": 0} == {**scene, "asset": 0}, "the program makes another scene of the same points")
    listed = [each for each in console.get("/api/folder")[1]["scenes"] if each["file"] == "to_target.json"]
    check(listed and "error" not in listed[0] and listed[0]["live_hand"], f"{listed}")
    status, answer = console.post(PATH, body)
    check(status == 409 and "to_target.json already" in answer["error"], f"the name again: {status} {answer}")
    check(files_of(folder) == after, "the scene was replaced")


def until(console, state):
    end = time.monotonic() + WITHIN_s
    while time.monotonic() < end and console.get(PATH)[1]["state"] != state:
        time.sleep(0.002)


def test_name_taken_meanwhile(console, folder):
    check(console.post(PATH, {"asset": "sample.glb", "name": "taken"})[0] == 200, "a scene whose name will be taken")
    (folder / "taken.json").write_text("another file")
    told, _ = result(console)
    check("scene" not in told and "taken.json already" in told["error"], f"{told}")
    check((folder / "taken.json").read_text() == "another file" and not list(folder.glob("*.making")), "a file was replaced or left")


def test_stopped_check(console, folder):
    check(console.post(PATH, {"asset": "sample.glb", "name": "unchecked"})[0] == 200, "a scene whose check will be stopped")
    until(console, "checking")
    console.post("/api/command", {"command": "stop"})
    told, _ = result(console)
    check(told["scene"] == "unchecked.json" and told["stopped"] and "warnings" not in told, f"{told}")
    check((folder / "unchecked.json").exists(), "the scene is gone")


STAND_IN = """#!/bin/sh
echo "$@" >> {said}
case "$*" in
  new-scene*) {make} ;;
  check*) echo "what the check says"; echo "trocar-run: warning: x.json: at 1 s: too soft" >&2; echo "trocar-run: warning: x.json: second" >&2; {check} ;;
esac
"""
MAKE = 'while [ $# -gt 0 ]; do if [ "$1" = -o ]; then echo "{}" > "$2"; fi; shift; done; echo made'


def test_stand_in(folder, points):
    """What the console makes of trocar-run's words and ends, with a stand-in for it: findings, a check that fails, a program that dies."""
    own = WORK / "programs"
    own.mkdir()
    shutil.copy(CONSOLE, own)
    for name, make, ends, expected in (("found", MAKE, "exit 0", {"warnings": ["at 1 s: too soft", "second"], "check": "what the check says\n", "end": "exit code 0"}),
                                       ("failed", MAKE, "exit 3", {"end": "exit code 3"}), ("died", "kill -9 $$", "", {"end": "signal 9", "text": ""})):
        said = WORK / f"{name}.said"
        (own / "trocar-run").write_text(STAND_IN.format(said=said, make=make, check=ends))
        (own / "trocar-run").chmod(0o755)
        console = Console(own / "trocar-console", folder, "--stiffness-limit", "1234", page=PAGE)
        check(console.post(PATH, {"asset": "sample.glb", "name": name, "entry_mm": points[0]})[0] == 200, f"{name}: the start")
        told, _ = result(console)
        check(expected.items() <= told.items() and ("scene" in told) == (name != "died") and ("warnings" in told) == (name == "found"), f"{name}: {told}")
        check("check" not in told or name == "found" or "too soft" in told["check"], f"{name}: {told}")
        words = said.read_text().splitlines()
        check(len(words) == (1 if name == "died" else 2) and all("--device inproc --stiffness-limit 1234" in line for line in words), f"{name}: {words}")
        check(console.stop() == 0, f"{name}: the console did not end as it should")


def test_stop(console, folder):
    check(console.post(PATH, {"asset": "sample.glb", "name": "stopped"})[0] == 200, "a scene to be stopped")
    check(console.post("/api/command", {"command": "stop"}) == (200, {"ok": True}), "the stop")
    told, _ = result(console)
    check(told.get("stopped") and "scene" not in told and not (folder / "stopped.json").exists(), f"{told}")
    check(console.post("/api/command", {"command": "stop"})[0] == 409, "a stop of nothing")
