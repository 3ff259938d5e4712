# SPDX-License-Identifier: Apache-2.0
"""clang_tidy.py ROOT BUILD [REGEX]: clang-tidy over the compile database, in parallel.

A file that passes leaves a stamp in the user's cache folder and is skipped while its digest
stays the same, in any clone on this machine. The digest is of the file, the project's headers
that it includes (from ninja's record of its last compilation; all headers if there is none),
.clang-tidy, the version of clang-tidy and the compile command, with paths relative to the clone.
Exit 0 if all pass, 1 otherwise.
"""
import concurrent.futures
import hashlib
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import time

OURS = ("formats", "pipeline", "runtime", "sample_ct", "tests")
PROGRAM = "clang-tidy-14"


def headers_of_objects(build):
    """{object file relative to the build folder: the files that its last compilation read}."""
    listing = subprocess.run(["ninja", "-C", str(build), "-t", "deps"], stdout=subprocess.PIPE,
                             stderr=subprocess.DEVNULL, text=True, check=False).stdout
    read, object_file = {}, None
    for line in listing.splitlines():
        if line.startswith("    "):
            if object_file:
                read[object_file].append(pathlib.Path(os.path.normpath(build / line.strip())))
        elif ": #deps" in line:
            name, rest = line.split(": #deps", 1)
            object_file = name if "(VALID)" in rest else None
            if object_file:
                read[object_file] = []
    return read


def digest_of(entry, root, build, read, every_header, version):
    digest = hashlib.sha256(version + (root / ".clang-tidy").read_bytes())
    words = shlex.split(entry["command"])
    output = words[words.index("-o") + 1] if "-o" in words else ""
    headers = [h for h in read[output] if h.is_relative_to(root)] if output in read else every_header
    for file in sorted({*headers, pathlib.Path(entry["file"])}):
        digest.update(os.path.relpath(file, root).encode())
        digest.update(file.read_bytes() if file.exists() else b"")
    command = entry["command"].replace(str(build), "BUILD").replace(str(root), "ROOT")
    digest.update(command.encode())
    return digest


def run_one(entry, build):
    start = time.monotonic()
    done = subprocess.run(
        [PROGRAM, "--quiet", "-p", str(build), entry["file"]],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
    return entry, done, time.monotonic() - start


def main():
    root, build = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    wanted = re.compile(sys.argv[3] if len(sys.argv) > 3 else "")
    database = json.loads((build / "compile_commands.json").read_text())
    read = headers_of_objects(build)
    every_header = [h for folder in OURS for h in (root / folder).rglob("*.h")]
    version = subprocess.run([PROGRAM, "--version"], stdout=subprocess.PIPE, check=True).stdout
    stamps = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "trocar-clang-tidy"
    stamps.mkdir(parents=True, exist_ok=True)
    todo, total = [], 0
    for entry in sorted(database, key=lambda e: e["file"]):
        path = pathlib.Path(entry["file"])
        if not path.is_relative_to(root) or path.is_relative_to(build):
            continue
        if not wanted.search(str(path.relative_to(root))):
            continue
        total += 1
        digest = digest_of(entry, root, build, read, every_header, version)
        stamp = stamps / digest.hexdigest()
        if not stamp.exists():
            # Largest first, so that no core works alone on a large file at the end.
            todo.append((path.stat().st_size, str(path), entry, stamp))
    todo.sort(key=lambda t: (-t[0], t[1]))
    stamp_of = {t[1]: t[3] for t in todo}
    failed = []
    with concurrent.futures.ThreadPoolExecutor(max_workers=len(os.sched_getaffinity(0))) as pool:
        for entry, done, seconds in pool.map(lambda t: run_one(t[2], build), todo):
            name = os.path.relpath(entry["file"], root)
            print(f"{'ok  ' if done.returncode == 0 else 'FAIL'} {seconds:6.1f} s  {name}", flush=True)
            if done.returncode == 0:
                stamp_of[entry["file"]].touch()
                continue
            failed.append(name)
            print(done.stdout.rstrip() or done.stderr.rstrip(), flush=True)
    print(f"clang-tidy: {total} files, {total - len(todo)} unchanged since they passed, "
          f"{len(failed)} with findings")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
