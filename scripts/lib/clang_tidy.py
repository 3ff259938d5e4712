# SPDX-License-Identifier: Apache-2.0
"""clang_tidy.py ROOT BUILD [--since COMMIT] [REGEX]: clang-tidy over the compile database of batches (CMake's unity build)."""
# A batch is all sources of a library or program, so that headers are parsed and checked once.
# With --since only the batches with a source that differs from the commit, and for each header that differs at least one batch that
# includes it. If the commit is not in this clone, all.
# A batch that passes leaves a stamp in the user's cache folder and is skipped while its digest
# stays the same, in any clone on this machine. The digest is of its sources, the project's headers
# that they include, .clang-tidy, the version of clang-tidy and the compile command, with paths relative to the clone.
# Exit 0 if all pass, 1 otherwise.
import argparse
import concurrent.futures
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys
import time

PROGRAM = "clang-tidy-14"
OURS = ("formats", "pipeline", "runtime", "sample_ct", "tests")
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)


def includes_of_files(root):
    """{file: the files of ours that it includes}."""
    paths = {path for folder in OURS for path in (root / folder).rglob("*") if path.suffix in (".h", ".cpp")}
    return {path: {root / name for name in INCLUDE.findall(path.read_text(encoding="utf-8", errors="replace"))} & paths
            for path in paths}


class Batch:
    def __init__(self, entry, includes):
        self.entry = entry
        file = pathlib.Path(entry["file"])
        self.sources = {file} if file in includes else {pathlib.Path(name) for name in INCLUDE.findall(file.read_text())} & includes.keys()
        self.read = set(self.sources)
        waiting = list(self.sources)
        while waiting:
            more = includes[waiting.pop()] - self.read
            self.read |= more
            waiting += more

    def digest(self, root, build, version):
        digest = hashlib.sha256(version + (root / ".clang-tidy").read_bytes())
        for file in sorted(self.read):
            digest.update(os.path.relpath(file, root).encode() + file.read_bytes())
        # The target that a file belongs to changes nothing; its flags do.
        command = re.sub(r" (-o|-c) \S+", "", self.entry["command"])
        digest.update(command.replace(str(build), "BUILD").replace(str(root), "ROOT").encode())
        return digest.hexdigest()


def since(commit, batches, root):
    """The batches with a source that differs from the commit, or with a header that does and that no other one includes."""
    done = subprocess.run(["git", "-C", root, "diff", "--name-only", "-z", commit], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        print(f"clang-tidy: {commit} is not in this clone: all files")
        return batches
    changed = {root / name for name in done.stdout.split("\0") if name}
    if root / ".clang-tidy" in changed:
        return batches
    chosen = [batch for batch in batches if batch.sources & changed]
    for header in sorted(path for path in changed if path.suffix == ".h"):
        including = [batch for batch in batches if header in batch.read]
        if including and not any(header in batch.read for batch in chosen):
            chosen.append(min(including, key=lambda batch: len(batch.read)))
    return chosen


def run_one(batch, build, root):
    start = time.monotonic()
    done = subprocess.run(
        [PROGRAM, "--quiet", "-p", str(build), "--checks=-bugprone-suspicious-include",
         f"--header-filter=^{re.escape(str(root))}/({'|'.join(OURS)})/.*\\.(h|cpp)$", batch.entry["file"]],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
    return batch, done, time.monotonic() - start


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("root", type=pathlib.Path)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--since", default="")
    parser.add_argument("regex", nargs="?", default="")
    options = parser.parse_intermixed_args()  # the expression may follow the options
    root, build, wanted = options.root, options.build, re.compile(options.regex)
    includes = includes_of_files(root)
    batches = [Batch(entry, includes) for entry in json.loads((build / "compile_commands.json").read_text())]
    batches = [batch for batch in batches if any(wanted.search(str(path.relative_to(root))) for path in batch.sources)]
    total = len(batches)
    if options.since:
        batches = since(options.since, batches, root)
    version = subprocess.run([PROGRAM, "--version"], stdout=subprocess.PIPE, check=True).stdout
    stamps = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "trocar-clang-tidy"
    stamps.mkdir(parents=True, exist_ok=True)
    todo = [batch for batch in batches if not (stamps / batch.digest(root, build, version)).exists()]
    # Largest first, so that no core works alone on a large one at the end.
    todo.sort(key=lambda batch: -sum(path.stat().st_size for path in batch.sources))
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(max_workers=len(os.sched_getaffinity(0))) as pool:
        for batch, done, seconds in pool.map(lambda each: run_one(each, build, root), todo):
            names = sorted(str(path.relative_to(root)) for path in batch.sources)
            print(f"{'ok  ' if done.returncode == 0 else 'FAIL'} {seconds:6.1f} s  {names[0]} and {len(names) - 1} more", flush=True)
            if done.returncode == 0:
                (stamps / batch.digest(root, build, version)).touch()
                continue
            failed += 1
            print(done.stdout.rstrip() or done.stderr.rstrip(), flush=True)
    print(f"clang-tidy: {len(batches)} of {total} batches, {len(batches) - len(todo)} unchanged since they passed, {failed} with findings")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
