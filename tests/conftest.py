# SPDX-License-Identifier: Apache-2.0
"""Fixtures and hooks of all Python tests."""
import shutil

import pytest

pytest.register_assert_rewrite("programs")
import programs as folders_of_test  # noqa: E402  (its assertions are rewritten)

SKIPPED = 77  # SKIP_RETURN_CODE in functions.cmake


@pytest.fixture(scope="session", autouse=True)
def empty_work_folder():
    shutil.rmtree(folders_of_test.WORK, ignore_errors=True)
    folders_of_test.WORK.mkdir(parents=True)


# The folders of support/programs.py as fixtures.


@pytest.fixture(scope="session")
def source():
    return folders_of_test.SOURCE


@pytest.fixture(scope="session")
def programs():
    return folders_of_test.PROGRAMS


@pytest.fixture(scope="session")
def scan():
    return folders_of_test.SCAN


@pytest.fixture(scope="session")
def work():
    return folders_of_test.WORK


@pytest.fixture
def place(work, request):
    """A new folder for one test."""
    out = work / request.node.name.replace("/", "_")
    out.mkdir(parents=True)
    return out


def pytest_sessionfinish(session):
    stats = session.config.pluginmanager.get_plugin("terminalreporter").stats
    if stats.get("skipped") and not any(stats.get(kind) for kind in ("passed", "failed", "error")):
        session.exitstatus = SKIPPED
