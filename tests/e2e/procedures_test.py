# SPDX-License-Identifier: Apache-2.0
"""`trocar-run --procedure` and a scene's "procedure": both give the same session, a stronger one needs more force, a recording says
which it was and replays to the bit, and `procedures` prints every value with its source."""
import json
import subprocess

from programs import run

NAMES = ("pedicle-probe", "jamshidi-8g", "vertebroplasty-11g", "bone-marrow-trephine", "spinal-needle", "tuohy-needle")


def test_procedures(programs, asset, work):
    trocar_run, file = programs / "trocar-run", work / "scene.json"
    run(trocar_run, "new-scene", asset, "-o", file, "--quiet")
    scene = json.loads(file.read_text())
    top = scene["body"]["top_z_m"]

    # The same through the command line and in the scene.
    session = ("--clock", "virtual", "--quiet", "--summary", work / "summary.json")
    forces = {}
    for strength in ("low", "median", "high"):
        run(trocar_run, file, "--procedure", "pedicle-probe", "--strength", strength, "--record", work / f"{strength}.csv", *session)
        forces[strength] = json.loads((work / "summary.json").read_text())["cutting"]["tip_max_N"]
    assert 0 < forces["low"] < forces["median"] < forces["high"], forces
    stated = {key: value for key, value in scene.items() if key not in ("tissue", "tissues", "layers", "tool")}
    stated["procedure"] = {"name": "pedicle-probe"}
    (work / "stated.json").write_text(json.dumps(stated))
    run(trocar_run, work / "stated.json", "--record", work / "stated.csv", *session)
    table = {name: [line.rsplit(",", 1)[0] for line in (work / f"{name}.csv").read_text().splitlines()] for name in ("median", "stated")}
    assert table["median"] == table["stated"] and len(table["median"]) > 1000

    # A recording says what it was made with.
    assert "procedure=pedicle-probe/high" in (work / "high.csv").read_text()
    replay = (trocar_run, "replay", file, work / "high.csv", "--quiet")
    run(*replay, "--procedure", "pedicle-probe", "--strength", "high")
    other = subprocess.run([str(word) for word in (*replay, "--procedure", "pedicle-probe")], capture_output=True, text=True, check=False)
    assert other.returncode == 3 and "procedure (pedicle-probe/high, here pedicle-probe/median)" in other.stderr, other

    # Through soft tissue: the hand must begin above the skin.
    for name in ("spinal-needle", "tuohy-needle", "vertebroplasty-11g"):
        below = subprocess.run([str(trocar_run), str(file), "--procedure", name, "--quiet"], capture_output=True, text=True, check=False)
        assert below.returncode == 3 and f"within the layers of {name}" in below.stderr, below
        soft = json.loads(json.dumps(stated)) | {"procedure": {"name": name, "strength": "low"}, "duration_s": 3}
        soft["body"]["top_z_m"] = 0.13
        soft["hand"]["trajectory"] = [{"t_s": 0, "tip_m": [0, 0, 0.22]}, {"t_s": 3, "tip_m": [0, 0, 0.129]}]
        (work / "soft.json").write_text(json.dumps(soft))
        run(trocar_run, work / "soft.json", *session)
        assert json.loads((work / "summary.json").read_text())["cutting"]["tissue_max_N"] > 0.5
    assert top < 0.2

    everything = run(trocar_run, "procedures").stdout
    for name in NAMES:
        one = run(trocar_run, "procedures", name).stdout
        assert one.startswith(name + ": ") and one in everything and "assumed" in one, name
