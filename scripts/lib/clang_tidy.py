# SPDX-License-Identifier: Apache-2.0
"""clang_tidy.py ROOT BUILD [--since COMMIT] [REGEX]: clang-tidy over the compile database, in parallel.

With --since only the translation units that differ from the commit, and for each header that differs at least one that
includes it. If the commit is not in this clone, all.

A file that passes leaves a stamp in the user's cache folder and is skipped while its digest
stays the same, in any clone on this machine. The digest is of the file, the project's headers
that it includes (from ninja's record of its last compilation; all headers if there is none),
.clang-tidy, the version of clang-tidy and the compile command, with paths relative to the clone.
Exit 0 if all pass, 1 otherwise.
"""
import argparse
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


def output_of(entry):
    words = shlex.split(entry["command"])
    return words[words.index("-o") + 1] if "-o" in words else ""


def since(commit, entries, read, root):
    """Those of the entries that differ from the commit, or include a header that does and that no other one includes."""
    done = subprocess.run(["git", "-C", root, "diff", "--name-only", "-z", commit], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        print(f"clang-tidy: {commit} is not in this clone: all files")
        return entries
    changed = {root / name for name in done.stdout.split("\0") if name}
    if root / ".clang-tidy" in changed:
        return entries
    chosen = [e for e in entries if pathlib.Path(e["file"]) in changed]
    seen = {header for e in chosen for header in read.get(output_of(e), [])}
    smallest_first = sorted(entries, key=lambda e: len(read.get(output_of(e), [])))
    for header in sorted(file for file in changed if file.suffix == ".h" and file not in seen):
        including = next((e for e in smallest_first if header in read.get(output_of(e), [])), None)
        if including:
            chosen.append(including)
            seen.update(read[output_of(including)])
    return chosen


def digest_of(entry, root, build, read, every_header, version):
    digest = hashlib.sha256(version + (root / ".clang-tidy").read_bytes())
    output = output_of(entry)
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
    parser = argparse.ArgumentParser()
    parser.add_argument("root", type=pathlib.Path)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--since", default="")
    parser.add_argument("regex", nargs="?", default="")
    options = parser.parse_args()
    root, build, wanted = options.root, options.build, re.compile(options.regex)
    read = headers_of_objects(build)
    every_header = [h for folder in OURS for h in (root / folder).rglob("*.h")]
    entries = []
    for entry in sorted(json.loads((build / "compile_commands.json").read_text()), key=lambda e: e["file"]):
        path = pathlib.Path(entry["file"])
        if path.is_relative_to(root) and not path.is_relative_to(build) and wanted.search(str(path.relative_to(root))):
            entries.append(entry)
    total = len(entries)
    if options.since:
        entries = since(options.since, entries, read, root)
    version = subprocess.run([PROGRAM, "--version"], stdout=subprocess.PIPE, check=True).stdout
    stamps = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "trocar-clang-tidy"
    stamps.mkdir(parents=True, exist_ok=True)
    todo = []
    for entry in entries:
        path = pathlib.Path(entry["file"])
        stamp = stamps / digest_of(entry, root, build, read, every_header, version).hexdigest()
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
    print(f"clang-tidy: {len(entries)} of {total} files, {len(entries) - len(todo)} unchanged since they passed, "
          f"{len(failed)} with findings")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
