# SPDX-License-Identifier: Apache-2.0
"""Every command of TUTORIAL.md, in order, in an empty folder.

TROCAR_PROGRAMS names the folder of installed programs, if these are to be run. TROCAR_HEAD_CT names
the head CT that scripts/head-ct makes; without it the commands are skipped.

How the page is read:
- ```sh: a command a line; a backslash continues it. Its exit code must be 0, or one that the line states:
  `# exit code 0 or 5`. A command that ends with another than the first of them must name a fault that a
  machine too slow for real time causes (STALLS); it is tried again, up to 4 times, and if it never ends with
  the first, the output shown for it is not compared.
  A command with `&` at its end goes on beside the next ```sh block and must end by itself after it, with 0.
  A command that calls scripts/head-ct becomes a copy of TROCAR_HEAD_CT.
- ```json NAME: a file, written as it stands.
- ```text: output of the ```sh block before it. Each of its lines must be a line of the output (stdout and
  stderr); `...` stands for any text, and a line of dots alone for any lines.
- A link to a file of the source tree must have its file.
"""
import os
import pathlib
import re
import shlex
import signal
import socket
import subprocess
import tempfile
import time
from dataclasses import dataclass, field

import pytest
from programs import HEAD_CT


ATTEMPTS = 4
TIMEOUT_S = 120
READY_S = 20  # until a background command has printed what the page shows
STATED_CODES = re.compile(r"#\s*exit code (\d+(?: or \d+)*)\s*$")
STALLS = ("no_data", "link_lost", "deadline_missed")
# Lines that the tutorial must show: without one of them a step is missing.
REQUIRED = ("valid", '"slice": 101', "identical", "largest force on the hand")


@dataclass
class Command:
    text: str
    codes: list
    background: bool


@dataclass
class Block:
    line: int  # of the page, for messages
    commands: list
    expected: list = field(default_factory=list)


@dataclass
class File:
    line: int
    name: str
    text: str


def commands_of(body):
    """A `Command` for each line; lines of comment are left out."""
    found = []
    for text in body.replace("\\\n", " ").splitlines():
        stated = STATED_CODES.search(text)
        codes = [int(code) for code in stated.group(1).split(" or ")] if stated else [0]
        text = (text[:stated.start()] if stated else text).strip()
        if not text or text.startswith("#"):
            continue
        background = text.endswith("&") and not text.endswith("&&")
        found.append(Command(text.rstrip("& ") if background else text, codes, background))
    return found


def parse(page):
    """The page's blocks and files, in order."""
    parts = []
    for fence in re.finditer(r"^```(\w*)[ \t]*(\S*)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL):
        kind, name, body = fence.groups()
        line = page.count("\n", 0, fence.start()) + 1
        if kind == "sh":
            parts.append(Block(line, commands_of(body)))
        elif kind == "json" and name:
            parts.append(File(line, name, body))
        elif kind == "text":
            if parts and isinstance(parts[-1], Block) and not parts[-1].expected:
                parts[-1].expected = [text for text in body.splitlines() if text.strip(" .")]
            else:
                pytest.fail(f"line {line}: output without a command before it")
        else:
            pytest.fail(f"line {line}: a block that is neither sh, text nor json with a file's name")
    return parts


def steps_of(parts):
    """Files alone; blocks in lists that are run, and tried again, together: those with a background command
    and the block after it."""
    steps, group = [], []
    for part in parts:
        if isinstance(part, File):
            steps.append(part)
            continue
        group.append(part)
        if not any(command.background for command in part.commands):
            steps.append(group)
            group = []
    if group:
        steps.append(group)
    return steps


def missing(expected, output):
    """The lines of `expected` that `output` does not have."""
    lines = [line.rstrip() for line in output.splitlines()]
    patterns = [".*".join(re.escape(piece) for piece in text.rstrip().split("...")) for text in expected]
    return [text for text, pattern in zip(expected, patterns) if not any(re.fullmatch(pattern, line) for line in lines)]


def text_of(log):
    log.seek(0)
    return log.read()


class Runner:
    """Runs blocks in the folder `work`, with `programs` first on the PATH."""

    def __init__(self, programs, work, head_ct, attempts):
        self.work, self.head_ct, self.attempts = work, head_ct, attempts
        self.environment = dict(os.environ, PATH=f"{programs}{os.pathsep}{os.environ['PATH']}", LC_ALL="C.UTF-8")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port = str(free.getsockname()[1])

    def here(self, text):
        """The page's text or lines, with a port that is free on this machine."""
        if isinstance(text, list):
            return [self.here(line) for line in text]
        return text.replace("127.0.0.1:4840", f"127.0.0.1:{self.port}")

    def start(self, command, log):
        text = re.sub(r"\S*scripts/head-ct (\S+)", rf"cp {shlex.quote(str(self.head_ct))} \1", self.here(command.text))
        return subprocess.Popen(["bash", "-c", text], cwd=self.work, env=self.environment, stdin=subprocess.DEVNULL,
                                stdout=log, stderr=subprocess.STDOUT, start_new_session=True)

    def finish(self, process, command, where, timeout_s=TIMEOUT_S):
        """Waits for the process: its exit code, None if it had to be killed, and what is wrong with that."""
        try:
            code = process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return None, [f"{where}: no end within {timeout_s} s"]
        return code, [] if code in command.codes else [f"{where}: ended with {code}"]

    def attempt(self, blocks):
        """Runs the blocks once: (what did not hold, whether each command ended with its first stated code)."""
        wrong, first, background, output = [], True, [], []
        for block in blocks:
            log = tempfile.TemporaryFile("a+", encoding="utf-8", errors="replace")
            output.append(log)
            for command in block.commands:
                started = (self.start(command, log), command, f"line {block.line}: {command.text}")
                if command.background:
                    background.append(started)
                    continue
                code, refused = self.finish(*started)
                if not refused and code != command.codes[0]:
                    first = False
                    if code != 0 and not any(name in text_of(log) for name in STALLS):
                        refused = [f"{started[2]}: ended with {code} for another reason than a slow machine"]
                wrong += [f"{line}\n{text_of(log)[-2000:]}" for line in refused]
            if block is not blocks[-1]:  # the next block's commands need these background commands
                end = time.monotonic() + READY_S
                while missing(self.here(block.expected), text_of(log)) and time.monotonic() < end:
                    time.sleep(0.02)
        for started in background:
            wrong += self.finish(*started, 1 if wrong else TIMEOUT_S)[1]
        if first and not wrong:
            shown = ""  # what a background command says at its end is shown with the block beside it
            for block, log in zip(blocks, output):
                shown += text_of(log)
                for line in missing(self.here(block.expected), shown):
                    wrong.append(f"line {block.line}: the output has no line {line!r}:\n{shown[-3000:]}")
        for log in output:
            log.close()
        return wrong, first

    def run(self, blocks):
        """What did not hold when these blocks were run."""
        for _ in range(self.attempts):
            wrong, first = self.attempt(blocks)
            if wrong or first:
                return wrong
        print(f"line {blocks[-1].line}: this machine is too slow for it; its output was not compared")
        return []


def run_page(page, runner):
    """What did not hold of a page."""
    wrong = []
    for step in steps_of(parse(page)):
        if isinstance(step, File):
            (runner.work / step.name).write_text(step.text, encoding="utf-8")
            continue
        wrong += runner.run(step)
        if wrong:
            break  # later steps need this step's files
    return wrong


def test_page(source):
    page = (source / "TUTORIAL.md").read_text(encoding="utf-8")
    shown = [line for part in parse(page) if isinstance(part, Block) for line in part.expected]
    for words in REQUIRED:
        assert any(words in line for line in shown), f"TUTORIAL.md shows no output with {words!r}"
    for target in re.findall(r"\]\(([^)#:]+)\)", page):
        assert (source / target).exists(), f"TUTORIAL.md links to {target}, which is not there"


def test_commands(programs, source, work):
    if not HEAD_CT.is_file():
        pytest.skip("TROCAR_HEAD_CT does not name the head CT (scripts/head-ct head.nii.gz fetches it)")
    programs = pathlib.Path(os.environ.get("TROCAR_PROGRAMS") or programs)
    for name in ("trocar-mesh", "trocar-run", "trocar-device-sim", "trocar-sample-ct"):
        assert (programs / name).is_file(), f"no {name} in {programs}"
    wrong = run_page((source / "TUTORIAL.md").read_text(encoding="utf-8"), Runner(programs, work, HEAD_CT, ATTEMPTS))
    assert not wrong, "\n".join(wrong)
