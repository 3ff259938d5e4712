# SPDX-License-Identifier: Apache-2.0
"""docs/add-your-device.md: its commands as a reader types them, with the example drive and its description of the device, and
what the page says of errors."""
import json
import os
import re
import signal
import socket
import subprocess

import pytest
from programs import SOURCE

PAGE = (SOURCE / "docs" / "add-your-device.md").read_text(encoding="utf-8")


def command(start):
    """The page's command that starts so: a line of a block of shell or `code`."""
    page = PAGE.replace("\\\n", " ")
    blocks = "".join(re.findall(r"^```sh\n(.*?)^```", page, flags=re.M | re.S))
    prose = re.sub(r"^```.*?^```", "", page, flags=re.M | re.S)
    lines = re.findall(r"^(\S.*?)(?:  +#.*)?$", blocks, re.M) + re.findall(r"`([^`]+)`", prose.replace("\n", " "))
    found = [line for line in lines if line.startswith(start)]
    assert len(found) == 1, f"{len(found)} commands start with {start!r}: {found}"
    return found[0]


class Lab:
    """The reader's folder, with a free port in place of the page's."""

    def __init__(self, folder, programs):
        self.folder, self.environment = folder, dict(os.environ, PATH=f"{programs}:{os.environ['PATH']}")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port = str(free.getsockname()[1])

    def run(self, line):
        """(exit code, stdout and stderr)"""
        done = subprocess.run(["bash", "-c", line.replace("7700", self.port)], cwd=self.folder, env=self.environment, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, check=False, timeout=120)
        return done.returncode, done.stdout

    def drive(self, line):
        drive = subprocess.Popen(line.replace("7700", self.port).split(), cwd=self.folder, stdout=subprocess.PIPE, text=True)
        assert drive.stdout.readline() == f"ready on 127.0.0.1:{self.port}\n"
        return drive


def end(drive):
    drive.send_signal(signal.SIGINT)
    assert drive.wait(10) == 0


@pytest.fixture(name="lab", scope="module")
def prepared_lab(work, programs):
    """Steps 1, 2 and 4, and the scene."""
    folder = work / "lab"
    folder.mkdir()
    lab = Lab(folder, programs)
    copied = command("cp formats/examples/pose_drive.cpp").split()[1]
    (folder / "pose_drive.cpp").write_bytes((SOURCE / copied).read_bytes())
    for start in ("g++ -std=c++20", "(umask 077; od", "trocar-sample-ct scan && trocar-mesh"):
        code, text = lab.run(command(start))
        assert code == 0, text
    assert re.fullmatch("[0-9a-f]{64}", (folder / "link.key").read_text(encoding="ascii"))
    assert (folder / "link.key").stat().st_mode & 0o777 == 0o600
    description = re.search(r"^```json\n(.*?)^```$", PAGE, re.M | re.S)[1]
    (folder / "my.json").write_text(description, encoding="ascii")
    assert set(json.loads(description)) <= set(json.loads((SOURCE / "formats/session/pose_device.schema.json").read_text())["properties"])
    (folder / "one_slice.json").write_bytes((SOURCE / "runtime/scenes/one_slice.json").read_bytes())
    return lab


def test_every_field_is_explained():
    fields = json.loads((SOURCE / "formats/session/pose_device.schema.json").read_text(encoding="utf-8"))["properties"]
    missing = [name for name in fields if f"`{name}`" not in PAGE]
    assert not missing, missing


def test_links():
    for target in re.findall(r"\]\(([^)#]+)", PAGE):
        assert (SOURCE / "docs" / target).exists(), target


def test_steps(lab):
    drive = lab.drive(command("./pose_drive link.key 7700 move").removesuffix(" move"))
    code, text = lab.run(command("trocar-run test --device pose:127.0.0.1:7700"))
    end(drive)
    assert code in (0, 5) and text.endswith(("should hold.\n", "will not hold well.\n")), text
    assert " 0 packets refused" in text and "round trip" in text

    session, replay = command("trocar-run one_slice.json --asset sample.glb --device pose:"), command(
        "trocar-run replay one_slice.json session.csv --asset sample.glb")
    drive = lab.drive(command("./pose_drive link.key 7700 move"))
    code, text = lab.run(session)
    end(drive)
    assert code == 0, text
    replayed = lab.run(replay)
    assert replayed[0] == 0 and "identical" in replayed[1], replayed
    shown = re.search(r"```text\n(trocar-run: note:.*?)```", PAGE, re.S)[1].splitlines()
    for line in shown:
        # A session without a missed deadline names no causes.
        causes = re.escape(" (waking 78, device 3)")
        pattern = re.sub(r"\d+(\\\.\d+)?", r"\\d+(\\.\\d+)?", re.escape(line).replace(causes, "CAUSES")).replace("CAUSES", r"( \(.*\))?")
        assert re.search(pattern, text), f"{line}\nis not in\n{text}"


def test_errors(lab):
    """Messages of the page's table, and messages that say themselves what to do."""
    options = " --key-file link.key --device-description my.json --duration 1"
    start = "trocar-run one_slice.json --asset sample.glb --device "
    assert lab.run("(umask 077; od -An -vtx1 -N32 /dev/urandom | tr -d ' \\n' > other.key)")[0] == 0
    broken = lab.folder / "broken.json"
    broken.write_text((lab.folder / "my.json").read_text(encoding="ascii").replace("mass_kg", "mass"), encoding="ascii")
    shown = re.findall(r"^\| (`.*?) \|", PAGE[PAGE.index("## What can go wrong"):], re.M)

    def expect(message, line, code, is_on_page=False):
        assert not is_on_page or any(message in row for row in shown), f"{message!r} is not on the page"
        got, text = lab.run(line)
        assert got == code and message in text, f"{line} ended with {got}: {text}"

    expect("no device answers there: nothing listens on this port", start + "pose:127.0.0.1:7700" + options, 5, is_on_page=True)
    drive = lab.drive("./pose_drive link.key 7700")
    expect("the device there has another key", start + "pose:127.0.0.1:7700" + options.replace("link.key", "other.key"), 5, is_on_page=True)
    expect("Address already in use", "./pose_drive link.key 7700", 2, is_on_page=True)
    end(drive)
    code, text = lab.run(start + "pose:127.0.0.1:7700" + options.replace("my.json", "broken.json"))
    assert code == 3 and "broken.json: " in text and "mass" in text, text
