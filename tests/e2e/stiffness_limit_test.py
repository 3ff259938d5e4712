# SPDX-License-Identifier: Apache-2.0
"""The limits of the stiffness of contact: what the operator allows, what the device states, and half of what the stated mass allows
for a device process that may have motors. A recording names them, and its replay gives the same torques."""
import json

from device_link_e2e_test import Simulator
from programs import SOURCE, run


def rendered(summary):
    cutting = json.loads(summary.read_text())["cutting"]
    assert cutting["axis"] == "coupled", cutting
    return cutting["coupling_N_per_m"] * cutting["force_scale"]


def test_stiffness_limit(programs, asset, work):
    trocar_run, scene = programs / "trocar-run", work / "scene.json"
    run(trocar_run, "new-scene", asset, "-o", scene, "--quiet")
    summary = work / "summary.json"
    fast = ("--clock", "virtual", "--quiet", "--summary", summary)
    run(trocar_run, scene, *fast)
    full = rendered(summary)

    limit = full / 3
    run(trocar_run, scene, *fast, "--stiffness-limit", limit, "--record", work / "limited.csv")
    assert abs(rendered(summary) / limit - 1) < 1e-6
    assert "stiffness-limit=" in (work / "limited.csv").read_text()
    run(trocar_run, "replay", scene, "--quiet", work / "limited.csv", "--stiffness-limit", limit)
    run(trocar_run, "replay", scene, "--quiet", work / "limited.csv", expect=3)
    assert "the limit that the device or the operator states" in run(trocar_run, "check", scene, "--stiffness-limit", limit).stdout

    device = json.loads((SOURCE / "formats/session/four_legs.json").read_text())
    device["plate"]["stiffness_max_N_per_m"] = 5000
    (work / "soft.json").write_text(json.dumps(device))
    run(trocar_run, scene, *fast, "--device-description", work / "soft.json", "--stiffness-limit", limit)
    assert abs(rendered(summary) / min(limit, 5000) - 1) < 1e-6

    # Over the link.
    for words, part in (((), 0.5), (("--simulated",), 1)):
        record = work / f"link{part}.csv"
        with Simulator(programs, work, scene, "--clock", "lock-step", "--sessions", "1") as drive:
            run(trocar_run, scene, *fast, *drive.link(), "--record", record, *words)
            assert drive.process.wait(60) == 0
        assert abs(rendered(summary) / full / part - 1) < 1e-6
        assert ("stiffness-margin=2" in record.read_text()) == (part == 0.5)
        run(trocar_run, "replay", scene, "--quiet", record)
