# SPDX-License-Identifier: Apache-2.0
"""Every command of TUTORIAL.md, in order, in an empty folder.

TROCAR_PROGRAMS names the folder of installed programs, if these are to be run. TROCAR_HEAD_CT names
the head CT that scripts/head-ct makes; without it the commands are skipped.

How the page is read:
- ```sh: a command a line; a backslash continues it. Its exit code must be 0, or the one that the line states: `# exit code 3`.
  A command with `&` at its end goes on beside the next ```sh block and must end by itself after it, with 0.
  A command that calls scripts/head-ct becomes a copy of TROCAR_HEAD_CT.
- ```json NAME: a file, written as it stands.
- ```text: output of the ```sh block before it, and of commands that go on beside it. Each of its lines must be a line of the output (stdout and
  stderr); `...` stands for any text, and a line of dots alone for any lines.
- A link to a file of the source tree must have its file.
"""
import os
import re
import shlex
import socket
import subprocess
import time

import pytest

from programs import HEAD_CT

TIMEOUT_S = 120
READY_S = 20  # until a background command has printed what the page shows
# Lines that the tutorial must show: without one of them a step is missing.
REQUIRED = ("valid", '"slice": 101', "identical", "largest force on the hand")


@pytest.fixture(name="page")
def text_of_page(source):
    return (source / "TUTORIAL.md").read_text(encoding="utf-8")


def parts_of(page):
    """(kind, file's name, lines) of each block, with continued lines joined."""
    for kind, name, body in re.findall(r"^```(\w*)[ \t]*(\S*)\n(.*?)^```$", page, re.M | re.S):
        assert kind in ("sh", "text") or kind == "json" and name, f"a block that is neither sh, text nor json with a file's name: {body}"
        yield kind, name, body if kind == "json" else body.replace("\\\n", " ").splitlines()


def missing(expected, output):
    """The lines of `expected` that `output` does not have."""
    lines = [line.rstrip() for line in output.splitlines()]
    patterns = {text: ".*".join(re.escape(piece) for piece in text.rstrip().split("...")) for text in expected if text.strip(" .")}
    return [text for text, pattern in patterns.items() if not any(re.fullmatch(pattern, line) for line in lines)]


class Reader:
    """Types the page's commands in a new folder, with the programs' folder first on the PATH."""

    def __init__(self, programs, work):
        self.work, self.log, self.background = work / "folder", work / "log", []
        self.work.mkdir()
        self.environment = dict(os.environ, PATH=f"{programs}{os.pathsep}{os.environ['PATH']}", LC_ALL="C.UTF-8")

    def start(self, command):
        text = re.sub(r"\S*scripts/head-ct (\S+)", rf"cp {shlex.quote(str(HEAD_CT))} \1", command)
        with self.log.open("a") as log:
            return subprocess.Popen(["bash", "-c", text], cwd=self.work, env=self.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def finish(self, process, command, code):
        assert process.wait(TIMEOUT_S) == code, f"{command} ended with {process.returncode}:\n{self.said()}"

    def said(self):
        return self.log.read_text(encoding="utf-8", errors="replace")

    def type(self, lines):
        others = self.background
        if not others:
            self.log.write_text("")
        self.background = []
        for line in lines:
            command, _, code = line.partition("# exit code ")
            if not command.strip() or command.startswith("#"):
                continue
            if command.rstrip().endswith("&"):
                self.background.append((self.start(command.rstrip(" &")), command, 0))
            else:
                self.finish(self.start(command), command, int(code or 0))
        for other in others:
            self.finish(*other)

    def expect(self, lines):
        end = time.monotonic() + READY_S
        while self.background and missing(lines, self.said()) and time.monotonic() < end:
            time.sleep(0.02)
        assert not missing(lines, self.said()), f"{missing(lines, self.said())} is not in the output:\n{self.said()}"


def test_page(page, source):
    shown = [line for kind, _, lines in parts_of(page) if kind == "text" for line in lines]
    for words in REQUIRED:
        assert any(words in line for line in shown), f"TUTORIAL.md shows no output with {words!r}"
    for target in re.findall(r"\]\(([^)#:]+)\)", page):
        assert (source / target).exists(), f"TUTORIAL.md links to {target}, which is not there"


@pytest.mark.skipif(not HEAD_CT.is_file(), reason="TROCAR_HEAD_CT does not name the head CT (scripts/head-ct head.nii.gz fetches it)")
def test_commands(page, programs, work):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        page = page.replace("127.0.0.1:4840", f"127.0.0.1:{free.getsockname()[1]}")
    reader = Reader(os.environ.get("TROCAR_PROGRAMS") or programs, work)
    for kind, name, body in parts_of(page):
        if kind == "json":
            (reader.work / name).write_text(body, encoding="utf-8")
        elif kind == "sh":
            reader.type(body)
        else:
            reader.expect(body)
