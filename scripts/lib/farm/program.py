# SPDX-License-Identifier: Apache-2.0
"""`trocar-mesh batch` as scripts/farm needs it: what is not up to date in a store, and the command that makes some of it."""
import dataclasses
import json
import os
import shutil
import subprocess

from errors import BUG, NAME, REFUSED, USAGE, WRITE, FarmError


@dataclasses.dataclass(frozen=True)
class State:
    scans: int
    stale: dict  # name: why its last try failed; "" if it did not fail
    known: dict  # name: reason, of the scans that have failed and are not tried again
    asset_bytes: int  # of the scans that are done


def failure_of(why):
    return next((str(cause["reason"]) for cause in why if cause["cause"] == "failed"), "")


@dataclasses.dataclass(frozen=True)
class Program:
    path: str
    collection: str
    store: str

    def command(self, *options):
        return [self.path, "batch", self.collection, "-o", self.store, *options]

    def state(self, *options, within_s=None):
        """The state of the collection's scans in the store. `options`: further options of the dry run. `within_s`: it may take so long."""
        command = self.command("--dry-run", "--json", "--quiet", *options)
        try:
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False, timeout=within_s)
        except subprocess.TimeoutExpired:
            raise FarmError(WRITE, f"{self.path} batch --dry-run took more than {within_s} s") from None
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines()
            code = done.returncode if done.returncode in (USAGE, REFUSED, WRITE) else BUG
            raise FarmError(code, lines[-1].removeprefix("trocar-mesh: ") if lines else f"{self.path} ended with {done.returncode}")
        try:
            found = json.loads(done.stdout)
            return State(int(found["scans"]), {str(one["scan"]): failure_of(one["why"]) for one in found["stale"]},
                         {str(one["scan"]): str(one["reason"]) for one in found["known_failures"]}, int(found["asset_bytes"]))
        except (ValueError, KeyError, TypeError) as error:
            raise FarmError(BUG, f"{self.path} batch --dry-run --json: not what this version of {NAME} reads ({error!r})") from None

    def tidy(self):
        """Removes files that killed processes of this host left in the store, as every batch does when it starts. Failures are ignored."""
        subprocess.run(self.command("--only", os.devnull, "--quiet"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)


def find(path, root):
    """The path of the program: the one given, else the one built here, else that of PATH."""
    built = root / "build" / "release" / "bin" / "trocar-mesh"
    found = path or (str(built) if built.exists() else shutil.which("trocar-mesh"))
    if not found or not os.access(found, os.X_OK):
        raise FarmError(USAGE, f"--program {found or 'trocar-mesh'}: not found; install or build it, or give its path on the nodes")
    return os.path.abspath(found)
