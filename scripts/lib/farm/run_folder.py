# SPDX-License-Identifier: Apache-2.0
"""STORE.farm: the results of a run's tasks, on the same file system as the store and beside it. One scripts/farm a store; what an
interrupted one left is removed by the next, and nothing stays of one that has ended."""
import fcntl
import hashlib
import os
import pathlib
import shutil

from errors import USAGE, WRITE, FarmError


class RunFolder:
    def __init__(self, store):
        self.path = pathlib.Path(str(store) + ".farm")
        # The same for every run on this store, so that its tasks are found again.
        self.prefix = "trocar-" + hashlib.sha256(str(store).encode()).hexdigest()[:10] + "-"
        self.lock = None

    def __enter__(self):
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self.lock = open(self.path / "lock", "w")
        except OSError as error:
            raise FarmError(WRITE, f"{self.path}: {error.strerror}") from None
        try:
            fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FarmError(USAGE, f"{self.path}: another scripts/farm works on this store") from None
        self.clear()
        return self

    def __exit__(self, *_):
        shutil.rmtree(self.path, ignore_errors=True)
        self.lock.close()

    def clear(self):
        for file in self.path.iterdir():
            if file.name != "lock":
                file.unlink(missing_ok=True)

    def write_chunks(self, number, chunks):
        """The names of each chunk of round `number`; chunks count from 1."""
        try:
            for k, names in enumerate(chunks, 1):
                (self.path / f"names.{number}.{k}").write_text("\n".join(names) + "\n")
        except OSError as error:
            raise FarmError(WRITE, f"{self.path}: {error.strerror}") from None

    def results(self, number, wanted):
        """Chunk: exit code of the program, of those of the wanted chunks of round `number` that have ended."""
        out = {}
        for name in os.listdir(self.path):
            words = name.split(".")
            if len(words) == 3 and words[:2] == ["result", str(number)] and words[2].isdigit() and int(words[2]) in wanted:
                try:
                    out[int(words[2])] = int((self.path / name).read_text())
                except (OSError, ValueError):
                    continue  # not all there yet
        return out

    def last_line(self, number, chunk):
        """Of what the program said, unless it ended well."""
        try:
            lines = (self.path / f"log.{number}.{chunk}").read_text(errors="replace").strip().splitlines()
        except OSError:
            return ""
        return lines[-1] if lines else ""
