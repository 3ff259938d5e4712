# SPDX-License-Identifier: Apache-2.0
"""STORE.farm: the folder of a run's task results, beside the store on the same file system. A store has one scripts/farm at a time, which
removes the files of an interrupted run, and its own files when it ends. Each run has a sub-folder of its own: a task of an earlier run,
which was killed, writes to that run's sub-folder or nowhere, and its result is not taken for one of this run."""
import fcntl
import hashlib
import os
import pathlib
import secrets
import shutil

from errors import NAME, WRITE, FarmError


class RunFolder:
    def __init__(self, store):
        self.store = pathlib.Path(store)
        self.top = pathlib.Path(str(store) + ".farm")
        token = secrets.token_hex(4)
        self.path = self.top / token
        # The names of this store's jobs begin with the same prefix in every run, so that the tasks of an interrupted run are found again.
        # Those of this run also have a number of its own, because Slurm lists the ended tasks of earlier runs for some minutes.
        self.prefix = "trocar-" + hashlib.sha256(str(store).encode()).hexdigest()[:10] + "-"
        self.own_prefix = self.prefix + token + "-"
        self.lock = None
        self.was_left = False  # by a run that was killed

    def __enter__(self):
        if self.store.exists() and not (self.store.is_dir() and os.access(self.store, os.W_OK | os.X_OK)):
            raise FarmError(WRITE, f"{self.store}: is {'not writable' if self.store.is_dir() else 'no folder'}")
        try:
            self.top.mkdir(parents=True, exist_ok=True)
            self.lock = open(self.top / "lock", "w")
        except OSError as error:
            raise self.unusable(error) from None
        try:
            fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FarmError(WRITE, f"another {NAME} works on {self.store}; give the command again when it has ended") from None
        self.was_left = any(self.top.glob("*/names.*"))
        try:
            self.clear()
        except OSError as error:
            raise self.unusable(error) from None
        return self

    def __exit__(self, *_):
        shutil.rmtree(self.top, ignore_errors=True)
        self.lock.close()

    def unusable(self, error):
        return FarmError(WRITE, f"{self.top}, which the run needs beside the store: {error.strerror}")

    def clear(self):
        """Removes what all runs have left, and makes the sub-folder of this one. A task of an earlier run that still writes may keep that
        run's sub-folder from being removed; it does no harm."""
        for path in self.top.iterdir():
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            elif path.name != "lock":
                path.unlink(missing_ok=True)
        self.path.mkdir(exist_ok=True)

    def write_chunks(self, number, chunks):
        """Writes the names of each chunk of round `number`; chunks count from 1."""
        try:
            for k, names in enumerate(chunks, 1):
                (self.path / f"names.{number}.{k}").write_text("\n".join(names) + "\n")
        except OSError as error:
            raise FarmError(WRITE, f"{self.path}: {error.strerror}") from None

    def results(self, number, wanted):
        """The program's exit code for each of the wanted chunks of round `number` that has ended."""
        out = {}
        for name in os.listdir(self.path):
            words = name.split(".")
            if len(words) == 3 and words[:2] == ["result", str(number)] and words[2].isdigit() and int(words[2]) in wanted:
                try:
                    out[int(words[2])] = int((self.path / name).read_text())
                except (OSError, ValueError):
                    continue  # not yet completely visible
        return out

    def last_line(self, number, chunk):
        """The last line that the program printed, unless it ended well."""
        try:
            lines = (self.path / f"log.{number}.{chunk}").read_text(errors="replace").strip().splitlines()
        except OSError:
            return ""
        return lines[-1] if lines else ""
