# SPDX-License-Identifier: Apache-2.0
"""clang_tidy.py ROOT BUILD [--since COMMIT] [--most N] [REGEX]: clang-tidy over the compile database, in parallel."""
# With --since only the translation units that differ from the commit, and for each header that differs at least one that
# includes it. A file that differs only in its comments does not count. If the commit is not in this clone, all.
# A file that passes leaves a stamp in the user's cache folder and is skipped while its digest
# stays the same, in any clone on this machine. The digest is of the file, the project's headers
# that it includes, .clang-tidy, the version of clang-tidy and the compile command, with paths relative to the clone.
# Exit 0 if all pass, 1 otherwise. With --most, if more than N files would have to be checked, none is, and the last line says so.
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


def headers_of_files(root):
    """{translation unit: the headers of ours that it includes, directly or through others}."""
    lines = {path: [root / name for name in INCLUDE.findall(path.read_text(encoding="utf-8", errors="replace"))]
             for folder in OURS for path in (root / folder).rglob("*") if path.suffix in (".h", ".cpp")}

    def reached(unit):
        found, waiting = set(), [unit]
        while waiting:
            more = [path for path in lines.get(waiting.pop(), ()) if path in lines and path not in found]
            found.update(more)
            waiting += more
        return sorted(found - {unit})

    return {unit: reached(unit) for unit in lines if unit.suffix == ".cpp"}


def checked_text(text):
    """What clang-tidy checks in a source: the code, and those comments that it reads (NOLINT and /* name= */)."""
    code = subprocess.run(["g++", "-x", "c++", "-fpreprocessed", "-dD", "-E", "-P", "-"],
                          input=text, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False).stdout
    return code, [line for line in text.splitlines() if "NOLINT" in line or "/*" in line]


def differs_in_code(file, commit, root):
    before = subprocess.run(["git", "-C", root, "show", f"{commit}:{file.relative_to(root)}"],
                            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
    if before.returncode != 0 or not file.exists():
        return True
    return checked_text(before.stdout) != checked_text(file.read_text())


def since(commit, entries, read, root):
    """Those of the entries that differ from the commit, or include a header that does and that no other one includes."""
    done = subprocess.run(["git", "-C", root, "diff", "--name-only", "-z", commit], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        print(f"clang-tidy: {commit} is not in this clone: all files")
        return entries
    changed = {root / name for name in done.stdout.split("\0") if name}
    if root / ".clang-tidy" in changed:
        return entries
    changed = {file for file in changed if file.suffix in (".h", ".cpp") and differs_in_code(file, commit, root)}
    chosen = [e for e in entries if pathlib.Path(e["file"]) in changed]
    seen = {header for e in chosen for header in read[pathlib.Path(e["file"])]}
    smallest_first = sorted(entries, key=lambda e: len(read[pathlib.Path(e["file"])]))
    for header in sorted(file for file in changed if file.suffix == ".h" and file not in seen):
        including = next((e for e in smallest_first if header in read[pathlib.Path(e["file"])]), None)
        if including:
            chosen.append(including)
            seen.update(read[pathlib.Path(including["file"])])
    return chosen


def digest_of(entry, root, build, read, version):
    digest = hashlib.sha256(version + (root / ".clang-tidy").read_bytes())
    unit = pathlib.Path(entry["file"])
    for file in sorted({unit, *read[unit]}):
        digest.update(os.path.relpath(file, root).encode())
        digest.update(file.read_bytes() if file.exists() else b"")
    # The target that a file belongs to changes nothing; its flags do.
    command = re.sub(r" -o \S+", "", entry["command"]).replace(str(build), "BUILD").replace(str(root), "ROOT")
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
    parser.add_argument("--most", type=int, default=0)
    parser.add_argument("regex", nargs="?", default="")
    options = parser.parse_intermixed_args()  # the expression may follow the options
    root, build, wanted = options.root, options.build, re.compile(options.regex)
    read = headers_of_files(root)
    entries = []
    for entry in sorted(json.loads((build / "compile_commands.json").read_text()), key=lambda e: e["file"]):
        path = pathlib.Path(entry["file"])
        if path in read and wanted.search(str(path.relative_to(root))):
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
        stamp = stamps / digest_of(entry, root, build, read, version).hexdigest()
        if not stamp.exists():
            # Largest first, so that no core works alone on a large file at the end.
            todo.append((path.stat().st_size, str(path), entry, stamp))
    if options.most and len(todo) > options.most:
        print(f"clang-tidy: NOT CHECKED: {len(todo)} files, more than {options.most}; scripts/nightly lint checks them")
        return 0
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
