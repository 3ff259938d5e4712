# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the end-to-end tests, beside those of ../conftest.py."""
import json

import pytest
from programs import run


@pytest.fixture(scope="session")
def asset(programs, scan, work):
    """The asset of the sample scan, with trocar-mesh's own parameters."""
    run(programs / "trocar-mesh", scan / "dicom", "-o", work / "sample.glb", "--quiet")
    return work / "sample.glb"


@pytest.fixture(scope="session")
def shipped(source, asset):
    """shipped(NAME): a scene of runtime/scenes on this asset."""
    return lambda name: json.loads((source / "runtime/scenes" / f"{name}.json").read_text()) | {"asset": str(asset)}
