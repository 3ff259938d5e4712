# SPDX-License-Identifier: Apache-2.0
"""The pages of the console and of a review in a headless Chromium, driven by the scripts of console/; then what the page showed is compared with
recordings, reports and scenes. Times and frame rates are printed; TROCAR_JUDGE_TIMES=1 checks them against their bounds."""
import bisect
import json
import math
import os
import re
import shutil
import socket
import threading

import numpy as np
import pytest
from PIL import Image

from chromium_page import PAGE, drive, links_of, need_browser, page_of
from console_client import Closed, Console, container
from console_server_test import add_outside, make_folder
from console_trouble_test import console_on_small_disk
from device_link_e2e_test import Simulator
from e2e import check
from exported import rows_of
from html_pages import embedded_json
from machine_stalls import MachineStalls
from programs import HEAD_CT, PROGRAMS, SCAN, SOURCE, WORK, run
from review_page import large_store, queries, small_stores
from session_report_test import goals

JUDGES_TIMES = os.environ.get("TROCAR_JUDGE_TIMES")
BONE_ms, FPS_SURFACE, FPS_SLICES = 2000, 30, 10
BAR_N, BAR_FRACTION = 1, 0.03        # how far the bar of the hand may be from the recording
MOTION_ms = 25                       # from the target to the tip's first motion
PICTURE_ms, PICTURES_PER_S = 1500, 30
FOREIGN = "foreign.csv"
DEAD = "udp:127.0.0.1:9"  # nobody answers there


@pytest.fixture(autouse=True, scope="module")
def browser():
    need_browser()


def new_folder(name, *options, below=""):
    """A folder for the console with the sample's asset, made with these options and a surface."""
    folder = WORK / name
    (folder / below).mkdir(parents=True)
    run(PROGRAMS / "trocar-mesh", SCAN / "dicom", "-o", folder / "sample.glb", "--surface", "--quiet", *options)
    return folder


def shipped(name, **fields):
    return json.loads((SOURCE / "runtime/scenes" / f"{name}.json").read_text()) | {"asset": "sample.glb"} | fields


def write(file, scene):
    file.write_text(json.dumps(scene))


def check_replay(scene, recording, *options, expect=0):
    again = WORK / "again.csv"
    run(PROGRAMS / "trocar-run", "replay", scene, recording, "--record", again, "--quiet", *options, expect=expect)
    check(again.read_bytes() == recording.read_bytes(), f"{recording}: the replay differs")


def check_bone(picture):
    """The pixels of the bone differ from the plain background and from each other: they show HU as colours."""
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    height, width = pixels.shape[:2]
    middle = pixels[int(0.3 * height):int(0.8 * height), int(0.25 * width):int(0.75 * width)]
    background = pixels[height // 2, int(0.02 * width)]
    is_bone = np.abs(middle - background).sum(2) > 30
    check(is_bone.mean() > 0.05, f"{picture.name}: no bone")
    colours = len(np.unique(middle[is_bone].reshape(-1, 3), axis=0))
    check(colours > 100, f"{picture.name}: only {colours} colours")


def test_sessions_page():
    """Lists, three slices and a vertebra, holes, faults, recovery, emergency stop, playback, report."""
    folder = new_folder("sessions")
    three, vertebra, network = (shipped(name) for name in ("three_slices", "vertebra", "network_middle"))
    # One in which the tool stays above the slices: a recovery needs that.
    hand = three["hand"] | {"trajectory": three["hand"]["trajectory"][:1] + [{"t_s": 60, "tip_m": [0, 0, 0.202]}]}
    beside = json.loads(json.dumps(vertebra))
    for frame in beside["hand"]["trajectory"]:
        frame["tip_m"][0] += 0.004
    hostile = '<img src="x" onerror="document.title=1"><b>'
    # `alone` is the first one of the list, which the page does not choose, because it has no whole bone.
    scenes = {"three_slices": three, "vertebra": vertebra, "network_middle": network, "beside": beside, "alone": network,
              "waiting": three | {"name": "Waiting", "duration_s": 60, "hand": hand}, hostile: {"schema": "trocar.scene/1", "name": "<b>bold</b>"}}
    for name, scene in scenes.items():
        write(folder / f"{name}.json", scene)
    with page_of(PROGRAMS, folder, WORK, "--device", "inproc", "--device", "sim") as (console, given):
        with MachineStalls() as machine:
            figures = drive("drive.mjs", {**given, "console_pid": console.process.pid, "scenes": [f"{name}.json" for name in scenes]})["figures"]
    print(machine, json.dumps(figures))
    check(figures["fps_surface"] > 0 and figures["fps_slices"] > 0, "no frame was drawn while frames were counted")
    if JUDGES_TIMES:
        check(figures["bone_shown_ms"] <= BONE_ms, f"the bone was shown after {figures['bone_shown_ms']} ms")
        check(figures["fps_surface"] >= FPS_SURFACE, f"{figures['fps_surface']} frames a second with surface and near slices")
        check(figures["fps_slices"] >= FPS_SLICES, f"{figures['fps_slices']} frames a second with 35 slices")
    for name in ("bone_three_slices.png", "bone_vertebra.png"):
        check_bone(WORK / "pictures" / name)
    # With --start, a session starts when the operator's page is opened: not before, not for the audience, and once.
    with page_of(PROGRAMS, folder, WORK, "--start", "waiting.json") as (_, given):
        drive("drive_start.mjs", given)


def check_bar(name, recording, samples):
    """What the bar said in each frame is the force of that tick in the recording."""
    rows = rows_of(recording)
    times = [float(row["t_s"]) for row in rows]
    for t_s, said_N, _ in samples:
        row = rows[min(bisect.bisect_left(times, t_s - 1e-9), len(rows) - 1)]
        check(abs(float(row["t_s"]) - t_s) < 1e-6, f"{name}: the recording has no tick at {t_s} s")
        force_N = sum(float(row[f"f{axis}_delivered_N"]) ** 2 for axis in "xyz") ** 0.5
        check(abs(said_N - force_N) <= max(BAR_N, BAR_FRACTION * force_N), f"{name}: at {t_s} s the bar said {said_N} N, the recording has {force_N} N")
    peak = max((said for _, said, _ in samples), default=0)
    check(len(samples) > 20 and peak > 5, f"{name}: {len(samples)} frames, {peak} N at most")


def test_hand_page():
    """The needle held in the page: by keys, mouse, gamepad and touch; two pages and an audience; a page that hangs, is closed, or loses its
    connection. What the bar said is the recorded force, and a replay gives the same bytes."""
    folder = new_folder("hand")
    scenes = {"slices_by_hand.json": shipped("three_slices"), "bone_by_hand.json": shipped("vertebra")}
    for name, scene in scenes.items():
        hand = scene["hand"] | {"live": True, "trajectory": scene["hand"]["trajectory"][:1]}
        write(folder / name, scene | {"duration_s": 300, "hand": hand})
    slices, bone = scenes
    with page_of(PROGRAMS, folder, WORK) as (_, given):
        result = drive("drive_hand.mjs", {**given, "slices": slices, "bone": bone})
    for name, session in result["sessions"].items():
        recording = folder / session["recording"]
        if name in ("keys", "gamepad"):
            check_bar(name, recording, session["samples"])
        check_replay(folder / (bone if name == "bone" else slices), recording, expect=5 if name == "keys" else 0)  # 5: it ends by an emergency stop
    check(set(result["sessions"]) == {"keys", "mouse", "gamepad", "bone", "pages", "touch"}, f"recordings of {set(result['sessions'])}")
    print(json.dumps(result["figures"]))
    if JUDGES_TIMES:
        check(result["figures"]["motion_ms"]["snapshot_median"] <= MOTION_ms, "from the target to the tip's first motion")


def check_counts(name, folder, session):
    """The counts of X-ray of the page, recording, summary, report and replay are the same."""
    recording = folder / session["recording"]
    flags = [int(row["xray"]) for row in rows_of(recording)]
    shots, beams = sum(flag & 1 for flag in flags), sum(flag >> 1 for flag in flags)
    check(shots == session["shots"], f"{name}: the page counts {session['shots']} shots, the recording has {shots}")
    check(abs(beams / 1000 - session["screening_s"]) < 1e-6, f"{name}: the page counts {session['screening_s']} s, the recording has {beams} ticks")
    wanted = {"shots": shots, "screening_s": beams / 1000}
    summary, said = recording.parent / "session.summary.json", WORK / "again.json"
    check(json.loads(summary.read_text())["xray"] == wanted, f"{name}: the summary")
    check(embedded_json((recording.parent / "session.html").read_text(), "report")["xray"] == wanted, f"{name}: the report")
    check_replay(folder / ("apart.json" if name == "apart" else "vertebra.json"), recording, "--summary", said)
    check(json.loads(said.read_text())["xray"] == wanted, f"{name}: the replay")
    return shots


def test_imaging_page():
    """X-ray and planes of the CT."""
    folder = new_folder("imaging", "--context", "2")
    write(folder / "vertebra.json", shipped("vertebra", duration_s=300))
    apart = shipped("three_slices", duration_s=300)
    for i, placed in enumerate(apart["slices"]):
        placed["z_m"] -= 0.03 * i
    write(folder / "apart.json", apart)
    # Another scene, of which only the recording is in the folder.
    write(WORK / "foreign.json", shipped("vertebra", asset="imaging/sample.glb", duration_s=8.4))
    run(PROGRAMS / "trocar-run", WORK / "foreign.json", "--clock", "virtual", "--record", folder / FOREIGN, "--quiet")
    with page_of(PROGRAMS, folder, WORK) as (_, given):
        result = drive("drive_imaging.mjs", {**given, "scene": "vertebra.json", "apart": "apart.json", "foreign": FOREIGN})
    shots = {name: check_counts(name, folder, session) for name, session in result["sessions"].items()}
    check(shots.get("hundred") == 100 and shots.get("vertebra", 0) >= 5 and "apart" in shots, f"{shots}")
    figures = result["figures"]
    print(json.dumps(figures))
    if JUDGES_TIMES:
        for what in ("ap_ms", "lateral_ms"):
            check(figures[what] <= PICTURE_ms, f"{what}: {figures[what]:.0f} ms from the key to the picture")
        check(figures["pictures_per_s"] >= PICTURES_PER_S, f"{figures['pictures_per_s']:.1f} pictures a second")


def check_goals(folder, scene, shown, recording):
    """`shown`: what the page showed of one scene: live, and in the middle, at the end and after going back in playback."""
    report = json.loads((folder / recording).with_suffix(".json").read_text())
    for when in ("live", "playback"):
        for goal, row in zip(report["goals"], shown[when]["list"]):
            check((row["goal"], row["zone"], row["state"] == "met", row["value"]) == (goal["goal"], goal["zone"], goal["met"], goal["value"]),
                  f"{scene} {when}: {row}, the report: {goal}")
        check(len(shown[when]["list"]) == len(report["goals"]) and f"{report['goals_met']} of {len(report['goals'])} goals met" in shown[when]["verdict"],
              f"{scene} {when}: {shown[when]['verdict']}")
    for goal, row in zip(report["goals"], shown["playback"]["seen"]):  # computed in the page from all rows of the recording
        if goal["goal"] == "plunge":
            continue
        is_same = row["value"] is None if goal["value"] is None else math.isclose(row["value"], goal["value"], rel_tol=1e-9, abs_tol=1e-12)
        check(is_same and (row["state"] in ("met", "kept")) == goal["met"], f"{scene}: {row}, the report: {goal}")
    for when in ("middle", "back"):
        check(shown[when]["verdict"].startswith("Goals so far") and len(shown[when]["list"]) == len(report["goals"]), f"{scene} {when}: {shown[when]}")
        check(all(row["words"] and "NaN" not in row["words"] for row in shown[when]["list"]), f"{scene} {when}: {shown[when]}")
    target = {when: next(row["value"] for row in shown[when]["list"] if row["goal"] == "target") for when in ("middle", "back")}
    check(target["back"] > target["middle"], f"{scene}: going back does not forget what came later: {target}")


def test_training_page():
    """The trainee of a session, live goals, verdict, history and ghost."""
    folder = make_folder()
    scene = json.loads((folder / "scenes/three_slices.json").read_text())
    for name, is_broken in (("met", False), ("broken", True)):
        write(folder / f"scenes/{name}.json", scene | {"name": name, "goals": goals(is_broken)})
    with page_of(PROGRAMS, folder, WORK) as (console, given):
        check(console.get("/api/history")[0] == 404, "a history without sessions")
        for said in ({"trainee": "Jane Doe"}, {"trainee": ""}, {"course": "../x"}, {"attempt": 0}, {"attempt": "1"}, {"trainee": 7}):
            status, answer = console.post("/api/start", {"scene": "scenes/met.json", **said})
            check(status == 400 and next(iter(said)) in answer["error"], f"{said}: {status} {answer}")
        result = drive("drive_training.mjs", given)
        for attempt, (scene, recording) in enumerate(result["sessions"].items(), 1):
            check_goals(folder, scene, result["goals"][scene], recording)
            check(f"trainee=A-17;course=spine_2026;attempt={attempt}" in rows_of(folder / recording)[0]["origin"], f"{recording}: the origin")
        for token in (console.token, console.view):
            status, page = console.request("GET", "/api/history", token=token, raw=True)
            check(status == 200 and "sandbox" in console.headers["Content-Security-Policy"], f"history: {status}")
            history = embedded_json(page.decode(), "history")
            check(sorted(each["attempt"] for series in history["series"] for each in series["sessions"]) == [1, 2, 3] and not history["skipped"], f"{history}")
        check(console.get("/api/history", token=None)[0] == 401, "a history without a token")


def largest_triangle(bone, arrays, below_m=0.0):
    """The middle of the largest triangle of the slice that lies so far below the topmost one, in {B}."""
    top = min(bone["slices"], key=lambda each: abs(each["z_m"] - bone["slices"][0]["z_m"] + below_m))
    numbers = lambda part, kind: np.frombuffer(arrays, kind, part[1], part[0])
    corners = numbers(top["vertices"], "<f4").reshape(-1, 2)[numbers(top["triangles"], "<u4").reshape(-1, 3)].astype(float)
    (a, b), (c, d) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    return [*corners[np.argmax(np.abs(a * d - b * c))].mean(axis=0), top["z_m"]]


def test_new_scene_page():
    """A new scene by clicking on the bone: the points that the page showed are those of the scene that was written."""
    folder = new_folder("new_scene", below="scenes")
    write(folder / "scenes/vertebra.json", shipped("vertebra", asset="../sample.glb"))
    apart = shipped("three_slices", asset="../sample.glb")
    for i, placed in enumerate(apart["slices"]):
        placed["z_m"] -= 0.001 * i
    write(folder / "scenes/apart.json", apart)
    point = lambda text: np.array([float(word) for word in text.split(",")])
    with page_of(PROGRAMS, folder, WORK) as (console, given):
        bone_of = lambda scene: container(console.request("GET", f"/api/bone?scene={scene}", raw=True)[1])
        bone, arrays = bone_of("scenes/vertebra.json")
        entry = largest_triangle(bone, arrays)
        said = drive("drive_new_scene.mjs", {**given, "entry": entry, "beside": largest_triangle(bone, arrays, 0.018)})["chosen"]
        there = np.array(bone["lps_mm_of_device"]) @ [*entry, 1]
        check(np.linalg.norm(point(said["section"]["entry"]) - there) < 0.4, f"the page says {said['section']}, the point is {there}")
        scene = json.loads((folder / "clicked.json").read_text())
        rows = np.array(bone_of("clicked.json")[0]["lps_mm_of_device"])
        for name, at_m in (("entry", scene["goals"]["line"]["entry_m"]), ("target", scene["goals"]["target"]["at_m"])):
            away = np.linalg.norm(rows @ [*at_m, 1] - point(said["made"][name]))
            check(away < 0.1, f"{name}: the page says {said['made'][name]}, the scene has {rows @ [*at_m, 1]}")
        check(scene["hand"]["live"] and "live" not in json.loads((folder / "thickest.json").read_text())["hand"], "the hand is not the one that was chosen")


def test_device_page():
    """The choice and the test of a device, with trocar-device-sim as the device."""
    folder = make_folder()
    scene = add_outside(folder, duration_s=60)
    add_outside(folder, "live", duration_s=60, hand={"live": True, "trajectory": scene["hand"]["trajectory"][:1]})
    (WORK / "keys").mkdir()
    with Simulator(PROGRAMS, WORK / "keys", folder / "scenes/outside.json", "--watchdog", "0.25") as simulator:
        key, device = f"key-file={simulator.key_file}", f"udp:{simulator.address}"
        with page_of(PROGRAMS, folder, WORK) as (_, plain), page_of(PROGRAMS, folder, WORK, "--device", "inproc", "--device", f"{device},{key},simulated",
                                                                    "--device", f"{DEAD},{key}") as (_, given):
            drive("drive_devices.mjs", {**given, "plain_link": plain["link"], "device": device, "dead": DEAD, "secret": str(WORK)})


def copy_bytes(source, target):
    try:
        while data := source.recv(65536):
            target.sendall(data)
    except OSError:
        pass
    for each in (source, target):
        each.close()


def tunnel_to(port):
    """A port whose connections are passed on to `port`."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve():
        while True:
            near = server.accept()[0]
            far = socket.create_connection(("127.0.0.1", port))
            for pair in ((near, far), (far, near)):
                threading.Thread(target=copy_bytes, args=pair, daemon=True).start()
    threading.Thread(target=serve, daemon=True).start()
    return server.getsockname()[1]


def watch(page):
    try:
        page.until(lambda live: False, 600)
    except (Closed, OSError):
        pass


def test_trouble_page():
    """What the page shows of sessions in trouble, that its keys do no harm, that the emergency stop and Restart do what they say, and pages that
    the console cannot serve as usual."""
    folder = make_folder()
    write(folder / "scenes/lost.json", json.loads((folder / "scenes/one_slice.json").read_text()) | {"name": "Lost asset", "asset": "../no_such.glb"})
    (folder / "scenes/broken.json").write_text("{", encoding="utf-8")
    add_outside(folder, duration_s=600, goals={"target": {"at_m": [0, 0, 0.11], "radius_m": 0.003}})
    with page_of(PROGRAMS, folder, WORK) as (console, given):
        drive("drive_trouble.mjs", given)
        drive("drive_rescue.mjs", {**given, "pid": console.process.pid})
    console = Console(PROGRAMS / "trocar-console", folder, page=PAGE)
    audience = [console.live(token=console.view) for _ in range(16)]
    check(all(page.next() == "hello" for page in audience), "sixteen pages watch")
    for page in audience:  # each answers the console's pings until the console ends
        threading.Thread(target=watch, args=(page,), daemon=True).start()
    made = console_on_small_disk(folder, "4m")
    small, links = made[0] if made else None, links_of(console)
    drive("drive_outside.mjs", {"full_link": links["link"], "full_view_link": links["view_link"], "tunnel": f"http://localhost:{tunnel_to(console.port)}/",
                                "disk_link": links_of(small)["link"] if small else None, "out": str(WORK / "pictures")})
    for each in filter(None, (console, small)):
        check(each.stop() == 0, "a console did not end as it should")
    shutil.rmtree(WORK / "disk", ignore_errors=True)


def test_tutorial_page():
    """TUTORIAL.md's step in the console, with its asset and scene. With TROCAR_PICTURES it leaves the step's pictures in WORK/pictures;
    copied to scripts/plots they are the tutorial's."""
    if not HEAD_CT.is_file():
        pytest.skip("TROCAR_HEAD_CT does not name the head CT (scripts/head-ct head.nii.gz fetches it)")
    text = (SOURCE / "TUTORIAL.md").read_text(encoding="utf-8")
    folder = WORK / "tutorial"
    folder.mkdir()
    words = re.search(r"^trocar-mesh head\.nii\.gz (.*) -o head\.glb$", text[text.index("## 3."):], re.M)[1].split()
    run(PROGRAMS / "trocar-mesh", HEAD_CT, *words, "-o", folder / "head.glb", "--quiet")
    scene = re.search(r"^```json puncture\.json\n(.*?)^```$", text, re.M | re.S)[1]
    (folder / "puncture.json").write_text(scene, encoding="utf-8")
    with page_of(PROGRAMS, folder, WORK) as (_, given):
        drive("drive_tutorial.mjs", given)


def test_review_page():
    """Search, filters, order and links of `trocar-mesh review`, by keyboard and mouse. What each search must find is computed from the store."""
    before, now = small_stores()
    store, large = large_store(before)
    (WORK / "pictures").mkdir(exist_ok=True)
    numbers = json.loads(run(PROGRAMS / "trocar-mesh", "review", store, "-o", WORK / "large.html", "--json").stdout)
    check(numbers["pages"] == ["large.html", "large-2.html", "large-3.html"], f"pages: {numbers['pages']}")
    run(PROGRAMS / "trocar-mesh", "review", now, "-o", WORK / "small.html", "--against", before)
    size = {name: (now / "assets" / f"{name}.glb").stat().st_size for name in ("first", "second", "third", "new_one")}
    drive("drive_review.mjs", {
        "out": str(WORK / "pictures"), "large": (WORK / "large.html").as_uri(), "small": (WORK / "small.html").as_uri(), "scans": list(large),
        "queries": queries(large), "different": ["second", "new_one"], "by_bytes": sorted(size, key=size.get, reverse=True) + ["missing"]})
