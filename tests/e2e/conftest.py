# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the end-to-end tests, beside those of ../conftest.py."""
import pytest
from programs import run


@pytest.fixture(scope="session")
def asset(programs, scan, work):
    """The asset of the sample scan, with trocar-mesh's own parameters."""
    run(programs / "trocar-mesh", scan / "dicom", "-o", work / "sample.glb", "--quiet")
    return work / "sample.glb"
