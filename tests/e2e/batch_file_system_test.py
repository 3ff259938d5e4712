# SPDX-License-Identifier: Apache-2.0
"""trocar-mesh batch on a file system without hard links: leases are created files there."""
import json
import os
import subprocess

import pytest
from batch_collection import write_collection
from programs import PROGRAMS, SANITIZED, run

MESH = PROGRAMS / "trocar-mesh"
WITHOUT_LINKS = {**os.environ, "LD_PRELOAD": str(PROGRAMS / "libno_hard_links.so")}


@pytest.mark.skipif(bool(SANITIZED), reason="a sanitizer must be the first library")
def test_without_hard_links(tmp_path):
    source = tmp_path / "a"
    source.write_text("x")
    refused = run("ln", source, tmp_path / "b", env=WITHOUT_LINKS, expect=None)
    assert refused.returncode != 0 and not (tmp_path / "b").exists(), "the library does not work"
    run(PROGRAMS / "trocar-sample-ct", tmp_path / "phantom", "--slices", 3, "--size", 64, "--quiet")
    scans = [{"name": f"s{k}", "input": "phantom/sample.nii.gz", "parameters": {"threshold": 150 + k}} for k in range(20)]
    collection = write_collection(tmp_path / "collection.json", scans)
    command = [str(MESH), "batch", str(collection), "-o", str(tmp_path / "store"), "--json"]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=WITHOUT_LINKS) for _ in range(2)]
    summaries = [json.loads(process.communicate()[0]) for process in both]
    assert sum(one["made"] for one in summaries) == 20, "two batches did work twice"
    assert not [path for top in ("tmp", "claims") for path in (tmp_path / "store" / top).iterdir()]
    run(MESH, "batch", collection, "-o", tmp_path / "with_links", "--quiet")
    for scan in scans:
        assert os.readlink(tmp_path / "store/assets" / f"{scan['name']}.glb") == os.readlink(tmp_path / "with_links/assets" / f"{scan['name']}.glb")
