# SPDX-License-Identifier: Apache-2.0
"""The console's page, or a review's, in a headless Chromium, for tests that drive it by a script of console/."""
import contextlib
import json
import os
import shutil
import subprocess

import pytest

from console_client import Console
from programs import SOURCE

DRIVERS = SOURCE / "tests" / "e2e" / "console"
PAGE = SOURCE / "runtime" / "console" / "page"
CHROMIUM = os.environ.get("TROCAR_CHROMIUM") or shutil.which("chromium")


def need_browser():
    """Skips the test, or with TROCAR_REQUIRE_CONSOLE fails, if something is missing."""
    if CHROMIUM and shutil.which("node") and (DRIVERS / "node_modules" / "playwright-core").is_dir() and (PAGE / "vendor").is_dir():
        return
    assert not os.environ.get("TROCAR_REQUIRE_CONSOLE"), "no chromium, node, playwright-core, or libraries of the page"
    pytest.skip("no chromium, node, playwright-core, or libraries of the page (scripts/setup test console, scripts/test)")


def links_of(console):
    return {"link": f"http://{console.host}/#{console.token}", "view_link": f"http://{console.host}/#{console.view}"}


@contextlib.contextmanager
def page_of(programs, folder, work, *options):
    """(a console of the folder, what its driver is given). Log and pictures go to `work`. It must end well."""
    (work / "pictures").mkdir(parents=True, exist_ok=True)
    with (work / "console.log").open("a") as log:
        console = Console(programs / "trocar-console", folder, *options, page=PAGE, stderr=log)
        yield console, {**links_of(console), "out": str(work / "pictures")}
        assert console.stop() == 0, "the console did not end as it should"


def drive(driver, given):
    """Runs a driver with these arguments, and checks its failures. Returns what it printed."""
    done = subprocess.run(["node", DRIVERS / driver, json.dumps({"chromium": CHROMIUM, **given})], cwd=DRIVERS, stdout=subprocess.PIPE, text=True,
                          check=False)
    assert done.returncode == 0 and done.stdout, f"{driver} ended with {done.returncode}"
    result = json.loads(done.stdout.splitlines()[-1])
    assert not result["failures"], "\n".join(result["failures"])
    return result
