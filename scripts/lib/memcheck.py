#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""memcheck.py BUILD SKIPS: the GoogleTest programs and fuzz replays of BUILD under valgrind's memcheck, which finds what
the other sanitizers do not: memory read before it is written. SKIPS lists those that are left out, with the reason."""

import concurrent.futures
import json
import os
import pathlib
import subprocess
import sys
import time

VALGRIND = ["valgrind", "--quiet", "--error-exitcode=99", "--leak-check=no", "--num-callers=20"]
# A mutant takes about fifty times as long under valgrind.
FEWER_MUTANTS = 50


def commands(build, skips):
    listed = json.loads(subprocess.run(["ctest", "--test-dir", build, "--show-only=json-v1"], check=True, capture_output=True, text=True).stdout)
    for test in listed["tests"]:
        command = test.get("command", [])
        if not command or pathlib.Path(command[0]).parent != build / "bin" or test["name"] in skips:
            continue
        if "--mutants" in command:
            at = command.index("--mutants") + 1
            command[at] = str(max(1, int(command[at]) // FEWER_MUTANTS))
        settings = [p["value"] for p in test["properties"] if p["name"] == "ENVIRONMENT"]
        yield test["name"], command, dict(s.split("=", 1) for group in settings for s in group)


def run(name, command, settings, folder):
    log = folder / f"{name}.log"
    began = time.monotonic()
    with log.open("w") as out:
        code = subprocess.run([*VALGRIND, *command], stdout=out, stderr=subprocess.STDOUT, env={**os.environ, **settings}).returncode
    return name, code, time.monotonic() - began, log


def main():
    build, skips_file = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    skips = {line.split()[0] for line in skips_file.read_text().splitlines() if line.strip() and not line.startswith("#")}
    folder = build / "memcheck"
    folder.mkdir(exist_ok=True)
    failed, tests = [], list(commands(build, skips))
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for done in concurrent.futures.as_completed([pool.submit(run, *test, folder) for test in tests]):
            name, code, seconds, log = done.result()
            print(f"{name}: {'clean' if code == 0 else f'failed ({code}), see {log}'} ({seconds:.0f} s)", flush=True)
            failed += [name] if code else []
    print(f"memcheck: {len(tests) - len(failed)} of {len(tests)} programs clean, {len(skips)} not run (see {skips_file.name})")
    sys.exit(bool(failed))


main()
