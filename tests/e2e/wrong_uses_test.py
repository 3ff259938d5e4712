# SPDX-License-Identifier: Apache-2.0
"""Every wrong use in wrong_uses.json, with its exit code and its message; and that docs/wrong-uses.md tells twelve of them as they are.

How the file is read:
- "files": name and lines of files that are written as they stand; "preparation": commands that make the other files, in a new empty folder.
- PROGRAM: rows [mistake, command, exit code, message]. The command is run by bash in that folder. The program must end with the exit code,
  and its standard error must be "PROGRAM: message" and nothing else. `...` in a message stands for a number or name that differs between
  machines or versions.
- After each command the folder holds the same files with the same bytes as before, except for NAME.partial if the message names it.
- Port 4840 stands for one that is taken, by a socket of this test.

As root, the commands run as another user, since nothing is forbidden to root.
"""
import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import tempfile
from dataclasses import dataclass

from programs import SOURCE


PROGRAMS = ("trocar-mesh", "trocar-run", "trocar-device-sim", "trocar-console", "trocar-sample-ct")
TIMEOUT_S = 60
NOBODY = 65534
ON_PAGE, PAGE_WORDS = 12, 400


@dataclass
class WrongUse:
    program: str
    mistake: str
    command: str
    code: int
    message: str

    def pattern(self):
        return ".+".join(re.escape(piece) for piece in f"{self.program}: {self.message}\n".split("..."))


class Folder:
    """A new folder with the files of wrong_uses.json, in which commands run."""

    def __init__(self, programs):
        self.path = pathlib.Path(tempfile.mkdtemp(prefix="trocar-wrong-uses-"))
        self.work, self.user = self.path / "work", {}
        self.work.mkdir()
        if os.geteuid() == 0:  # another user may not reach the programs where they are
            self.path.chmod(0o755)
            (self.path / "bin").mkdir()
            for name in PROGRAMS:
                shutil.copy(programs / name, self.path / "bin" / name)
            shutil.copytree(SOURCE / "runtime/console/page", self.path / "share/trocar/console", ignore=shutil.ignore_patterns("node_modules"))
            os.chown(self.work, NOBODY, NOBODY)
            self.user, programs = {"user": NOBODY, "group": NOBODY, "extra_groups": [], "umask": 0o022}, self.path / "bin"
        self.environment = dict(os.environ, PATH=f"{programs}{os.pathsep}{os.environ['PATH']}", LC_ALL="C.UTF-8", HOME=str(self.work))
        self.taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.taken.bind(("127.0.0.1", 0))
        self.port = str(self.taken.getsockname()[1])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.taken.close()
        for folder, names, _ in os.walk(self.path):
            for name in names:
                os.chmod(os.path.join(folder, name), 0o700)
        shutil.rmtree(self.path)

    def run(self, command):
        """(exit code, stderr); exit code None: it did not end."""
        try:
            done = subprocess.run(["bash", "-c", command.replace("127.0.0.1:4840", f"127.0.0.1:{self.port}")], cwd=self.work,
                                  env=self.environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                  text=True, errors="replace", timeout=TIMEOUT_S, check=False, **self.user)
        except subprocess.TimeoutExpired as late:
            return None, str(late.stderr)
        return done.returncode, done.stderr.replace(f"127.0.0.1:{self.port}", "127.0.0.1:4840")

    def prepare(self, table):
        for name, lines in table["files"].items():
            (self.work / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
            if self.user:
                os.chown(self.work / name, NOBODY, NOBODY)
        code, said = self.run("\n".join(("set -e", *table["preparation"])))
        assert code == 0 and not said, f"the preparation ended with {code}: {said}"

    def files(self):
        """Name and state of each file; a file that is written again has another state."""
        found = {}
        for folder, _, names in os.walk(self.work):
            found[folder] = 0
            for name in names:
                status = os.lstat(os.path.join(folder, name))
                found[os.path.join(folder, name)] = (status.st_size, status.st_mtime_ns, status.st_ino, status.st_mode)
        return found

    def try_out(self, use):
        """What did not hold."""
        before, wrong = self.files(), []
        code, said = self.run(use.command)
        if code != use.code or not re.fullmatch(use.pattern(), said):
            wrong.append(f"{use.command}\n  ended with {code}, not {use.code}, and said\n  {said!r}, not\n"
                         f"  {use.program}: {use.message}")
        after = self.files()
        for name in sorted(after.keys() - before.keys()):
            if name.endswith(".partial") and pathlib.Path(name).name in use.message:
                os.unlink(name)
            else:
                wrong.append(f"{use.command} left {name}")
        changed = [name for name, state in before.items() if after.get(name) != state]
        return wrong + [f"{use.command} changed {name}" for name in changed]


def test_wrong_uses(programs, source):
    table = json.loads((source / "tests/e2e/wrong_uses.json").read_text(encoding="utf-8"))
    uses = [WrongUse(program, *row) for program in PROGRAMS for row in table[program]]
    with Folder(programs) as folder:
        folder.prepare(table)
        wrong = [line for use in uses for line in folder.try_out(use)]
    print(f"{len(uses)} wrong uses")
    assert not wrong, "\n".join(wrong)


def test_the_page_tells_what_the_programs_say(source):
    table = json.loads((source / "tests/e2e/wrong_uses.json").read_text(encoding="utf-8"))
    known = {(mistake, command, code, f"{program}: {message}") for program in PROGRAMS for mistake, command, code, message in table[program]}
    page = (source / "docs/wrong-uses.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|`]+) \| `([^`]+)` \| (\d) \| `([^`]+)` \|$", page, re.M)
    told = [(mistake, command, int(code), message) for mistake, command, code, message in rows]
    assert len(set(told)) == len(told) == ON_PAGE and set(told) <= known, set(told) - known
    assert len(re.sub(r"```.*?```", "", page, flags=re.S).split()) <= PAGE_WORDS
