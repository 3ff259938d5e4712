# SPDX-License-Identifier: Apache-2.0
"""Runs of trocar-mesh, and what the readers give of a scan."""
import json
import struct
import subprocess

import numpy as np


def dump(programs, raw, axis, spacing, *scan):
    """The exit code of stack_dump (0 with its JSON and the slices' values, else with the line that it said)."""
    done = subprocess.run([programs / "stack_dump", raw, axis, spacing, *scan], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          check=False, timeout=60)
    if done.returncode != 0:
        return done.returncode, done.stderr.strip(), None
    out = json.loads(done.stdout)
    return 0, out, np.fromfile(raw, "<f4").reshape(len(out["slices"]), out["height"], out["width"])


class MeshRuns:
    def __init__(self, programs, work):
        self.mesh, self.work, self.count = programs / "trocar-mesh", work, 0

    def folder(self):
        self.count += 1
        out = self.work / f"{self.count:03}"
        out.mkdir()
        return out

    def run(self, scan, *words):
        """Exit code, lines on stderr, report, and the asset's JSON and bytes (None if nothing was written)."""
        asset, report = self.work / "out.glb", self.work / "out.json"
        for file in (asset, report):
            file.unlink(missing_ok=True)
        done = subprocess.run([self.mesh, scan, "-o", asset, "--report", report, *map(str, words)], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, check=False, timeout=120)
        lines = done.stderr.splitlines()
        if not asset.exists():
            assert not report.exists(), f"{scan}: a report without an asset"
            return done.returncode, lines, None, None, None
        data = asset.read_bytes()
        text = data[20 : 20 + struct.unpack_from("<I", data, 12)[0]]
        return done.returncode, lines, json.loads(report.read_bytes()), json.loads(text), data

    def refused(self, scan, *texts, words=(), code=3):
        """In one line that has these texts; returns it."""
        got, lines, report, *_ = self.run(scan, *words)
        ok = got == code and len(lines) == 1 and all(text in lines[0] for text in texts) and report is None
        assert ok, f"{scan} {words}: exit {got}, {lines} lacks one of {texts}"
        return lines[0]
