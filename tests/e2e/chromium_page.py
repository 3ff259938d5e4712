# SPDX-License-Identifier: Apache-2.0
"""The console's page, or a review's, in a headless Chromium, for tests that drive it by a script of console/."""
import contextlib
import json
import os
import pathlib
import shutil
import subprocess
import sys

from console_client import Console
from e2e import check

SOURCE = pathlib.Path(__file__).resolve().parents[2]
DRIVERS = SOURCE / "tests" / "e2e" / "console"
PAGE = SOURCE / "runtime" / "console" / "page"
CHROMIUM = os.environ.get("TROCAR_CHROMIUM") or shutil.which("chromium")


def need_browser(with_console=True):
    """Ends the test as skipped, or with TROCAR_REQUIRE_CONSOLE as failed, if something is missing."""
    why = ""
    if not CHROMIUM or not shutil.which("node") or not (DRIVERS / "node_modules" / "playwright-core").is_dir():
        why = "skipped: no chromium, node or playwright-core (scripts/setup test, scripts/test)"
    elif with_console and not (PAGE / "vendor").is_dir():
        why = "skipped: the page's libraries are missing (scripts/setup console)"
    if why:
        print(why)
        sys.exit(1 if os.environ.get("TROCAR_REQUIRE_CONSOLE") else 77)


def links_of(console):
    return {"link": f"http://{console.host}/#{console.token}", "view_link": f"http://{console.host}/#{console.view}"}


@contextlib.contextmanager
def page_of(programs, folder, work, *options):
    """(a console of the folder, what its driver is given). Log and pictures go to `work`. It must end well."""
    (work / "pictures").mkdir(parents=True, exist_ok=True)
    with (work / "console.log").open("a") as log:
        console = Console(programs / "trocar-console", folder, *options, page=PAGE, stderr=log)
        yield console, {**links_of(console), "out": str(work / "pictures")}
        check(console.stop() == 0, "the console did not end as it should")


def drive(driver, given):
    """Runs a driver with these arguments, and checks its failures. Returns what it printed."""
    done = subprocess.run(["node", DRIVERS / driver, json.dumps({"chromium": CHROMIUM, **given})], cwd=DRIVERS, stdout=subprocess.PIPE, text=True,
                          check=False)
    check(done.returncode == 0, f"{driver} ended with {done.returncode}")
    result = json.loads(done.stdout.splitlines()[-1]) if done.stdout else {"failures": [f"{driver} said nothing"], "figures": {}, "sessions": {}}
    for failure in result["failures"]:
        check(False, failure)
    return result
