# SPDX-License-Identifier: Apache-2.0
"""Starts the stand-in for the Haply service (tests/stand_ins/README.md) and reads what it wrote."""
import contextlib
import csv
import json
import os
import signal
import subprocess

from programs import PROGRAMS, WORK

PROGRAM = PROGRAMS / "haply_service_stand_in"
PATIENCE_S = 10


class StandIn:
    """Runs the stand-in on any free port, `port`. stop() ends it; without stop(), leaving a `with` block kills it. `name` is
    the start of the names of its files in the test's folder."""

    def __init__(self, *options, name="haply"):
        WORK.mkdir(parents=True, exist_ok=True)
        self.log, self.summary = WORK / f"{name}_forces.csv", WORK / f"{name}_summary.json"
        for file in (self.log, self.summary):
            file.unlink(missing_ok=True)
        words = [PROGRAM, "--port", 0, "--log", self.log, "--summary", self.summary, *options]
        self.process = subprocess.Popen(list(map(str, words)), stdout=subprocess.PIPE, text=True)
        with contextlib.suppress(PermissionError):  # a device does not wait for other processes
            os.sched_setscheduler(self.process.pid, os.SCHED_FIFO, os.sched_param(70))
        line = self.process.stdout.readline().split()
        assert line[:2] == ["listening", "on"], line
        self.port = int(line[2])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def stop(self, number=signal.SIGTERM):
        """(summary, rows of the log as dictionaries of numbers)"""
        self.process.send_signal(number)
        return self.ended()

    def ended(self):
        """As stop(), when it ends by itself."""
        assert self.process.wait(PATIENCE_S) == 0
        with open(self.log, encoding="ascii") as file:
            rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
        return json.loads(self.summary.read_text(encoding="ascii")), rows
