# SPDX-License-Identifier: Apache-2.0
"""Failures that end scripts/farm with one line and an exit code; the codes are those of the programs."""
DONE, BUG, USAGE, REFUSED, WRITE = 0, 1, 2, 3, 4


class FarmError(Exception):
    def __init__(self, code, message):
        super().__init__(message)
        self.code = code
