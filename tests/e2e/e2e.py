# SPDX-License-Identifier: Apache-2.0


def check(condition, message):
    assert condition, message
