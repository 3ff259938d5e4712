# SPDX-License-Identifier: Apache-2.0
"""untested.py SOURCE: lists the product files that no test names; tests/untested_test.py runs it too.

The test of FOLDER/STEM.h and FOLDER/STEM.cpp (or .js) is tests/FOLDER/STEM_test.cpp or _test.py, or the files that a line
"// Tests: tests/..." of one of them names, separated by commas. A file without a test is listed in tests/untested.txt, with the reason."""
import pathlib
import re
import sys

PRODUCT = ("formats", "pipeline", "runtime")
SUFFIXES = (".h", ".cpp", ".js")
FETCHED = {"vendor", "node_modules"}  # other people's files in a folder of ours
NAMED = re.compile(r"^\s*// Tests: (.*)$", re.MULTILINE)


def pairs(source):
    """{"FOLDER/STEM": [files with that name], relative to `source`}."""
    found = {}
    for folder in PRODUCT:
        for path in sorted((source / folder).rglob("*")):
            if path.suffix in SUFFIXES and not FETCHED & set(path.parts):
                found.setdefault(str(path.with_suffix("").relative_to(source)), []).append(str(path.relative_to(source)))
    return found


def problems(source):
    """What is wrong, as sentences: files without a test, named tests that do not exist, entries of the list that are out of date."""
    reasons, broken = {}, []
    for line in (source / "tests/untested.txt").read_text(encoding="utf-8").splitlines():
        if line.strip() and not line.startswith("#"):
            path, _, reason = line.partition(" ")
            reasons[path] = reason.strip()
    listed = dict(reasons)
    for name, files in pairs(source).items():
        named = [test.strip() for file in files for line in NAMED.findall((source / file).read_text(encoding="utf-8")) for test in line.split(",")]
        broken += [f"{files[0]}: its test {test} does not exist" for test in named if not (source / test).is_file()]
        mirrored = any((source / f"tests/{name}_test{suffix}").is_file() for suffix in (".cpp", ".py"))
        entries = [file for file in files if listed.pop(file, None) is not None]
        if not mirrored and not named and not entries:
            broken.append(f"{files[0]} has no test: add tests/{name}_test.cpp, a line \"// Tests: tests/...\", or a reason in tests/untested.txt")
        elif (mirrored or named) and entries:
            broken.append(f"tests/untested.txt: {entries[0]} has a test")
    broken += [f"tests/untested.txt: {file} does not exist" for file in listed]
    return broken + [f"tests/untested.txt: {file} has no reason" for file, reason in reasons.items() if not reason]


def main():
    found = problems(pathlib.Path(sys.argv[1]))
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
