# SPDX-License-Identifier: Apache-2.0
"""Failures that end scripts/farm with one line and an exit code, the codes of the programs; and the names that messages use. Installed
from the Debian package trocar-farm, the command is trocar-farm."""
import os

NAME = os.environ.get("TROCAR_FARM", "scripts/farm")
GET_SLURM = "scripts/setup farm" if NAME == "scripts/farm" else "apt install slurm-wlm munge"
VERSION = "0.2.0"  # of CMakeLists.txt
DONE, BUG, USAGE, REFUSED, WRITE = 0, 1, 2, 3, 4


class FarmError(Exception):
    def __init__(self, code, message):
        super().__init__(message)
        self.code = code
