# SPDX-License-Identifier: Apache-2.0
"""Shared by the tests of the measuring programs. The modules of scripts/report can be imported after this one."""
import json
import subprocess
import sys

from programs import PROGRAMS, SOURCE

LIBRARY = SOURCE / "scripts" / "lib" / "report"
sys.path[:0] = [str(LIBRARY), str(LIBRARY / "sections"), str(SOURCE / "scripts" / "plots")]


def sweep(program, plan):
    """The finished process of the program of that name, with `plan` (a text, or a document) on its standard input."""
    text = plan if isinstance(plan, str) else json.dumps(plan)
    return subprocess.run([PROGRAMS / program], input=text, stdout=subprocess.PIPE, text=True, check=False)
