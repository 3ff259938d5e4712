# SPDX-License-Identifier: Apache-2.0
"""The parts of the console's page that need no browser, in node (hand_page_test.mjs, playback_page_test.mjs, page_parts_test.mjs)."""
import os
import re
import shutil
import subprocess

import pytest


@pytest.mark.parametrize("script", ["hand_page_test.mjs", "playback_page_test.mjs", "page_parts_test.mjs"])
def test_page_in_node(source, script):
    node = shutil.which("node")
    if not node:
        assert not os.environ.get("TROCAR_REQUIRE_CONSOLE"), "node is missing (scripts/setup test)"
        pytest.skip("node is missing")
    page = source / "runtime/console/page"
    done = subprocess.run([node, "--test", source / "tests/runtime/console" / script], env={**os.environ, "TROCAR_PAGE": str(page)},
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, timeout=120)
    assert done.returncode == 0 and re.search(r"^# pass [1-9]", done.stdout, re.M), done.stdout
