# SPDX-License-Identifier: Apache-2.0
"""What the Python tools share: the exit codes of all programs, errors in one line, outputs that appear whole or not at all."""
import argparse
import contextlib
import os
import pathlib
import re
import sys
import warnings

import numpy as np

VERSION = "0.3.0"  # of CMakeLists.txt
USAGE, REFUSED, UNWRITABLE = 2, 3, 4
EXIT_CODES = "Exit codes: 0 done; 2 wrong usage; 3 input refused; 4 a file could not be written; 1 a bug."


class Failure(Exception):
    # Ends the program with an exit code and a line on stderr.

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


def refuse_if(*cases):
    # `cases`: (whether it is so, why the input is refused), ...
    for is_so, why in cases:
        if is_so:
            raise Failure(REFUSED, why)


@contextlib.contextmanager
def about(path):
    # Puts the file's name before the messages of failures.
    try:
        yield
    except Failure as failure:
        raise Failure(failure.code, f"{path}: {failure}") from failure


class Parser(argparse.ArgumentParser):
    # The options that all tools have. `output`: help text of -o.

    def __init__(self, prog, libraries, output, **keys):
        super().__init__(prog=prog, allow_abbrev=False, epilog=EXIT_CODES, **keys)
        self.add_argument("-o", "--output", metavar="FILE", required=True, help=output)
        self.add_argument("--quiet", action="store_true", help="print errors only")
        self.add_argument("--version", action="version", version=f"{prog} {VERSION} ({libraries})")

    def error(self, message):
        raise Failure(USAGE, f"{message} (see {self.prog} --help)")


def read_table(lines, types, names, separator=","):
    # The lines behind the header of a CSV file as an array of these types (of numpy). `names`: those of the columns.
    if not all(lines):
        raise Failure(REFUSED, f"line {lines.index('') + 2}: is empty")
    warnings.simplefilter("error", DeprecationWarning)  # a fraction in a column of integers
    try:
        return np.loadtxt(lines, types, delimiter=separator, comments=None, ndmin=1)
    except ValueError as error:  # numpy counts rows from 0 if it names a column, else from 1
        place = re.search(r"at row (\d+)(?:, column (\d+))?", str(error))
        if not place:
            raise Failure(REFUSED, "is not a table of numbers") from error
        row, column = place.groups()
        raise Failure(REFUSED, f"line {int(row) + 2}: {names[int(column) - 1]} is not a number" if column else
                      f"line {int(row) + 1}: must have {len(names)} fields") from error


def check_outputs(outputs, inputs):
    # `outputs`: {option: path or None}. Call it before long work.
    outputs = {option: pathlib.Path(path) for option, path in outputs.items() if path}
    for option, path in outputs.items():
        if not path.parent.is_dir():
            raise Failure(UNWRITABLE, f"{path}: there is no folder {path.parent}")
        if path.exists() and not path.is_file():
            raise Failure(UNWRITABLE, f"{path}: is not a regular file")
        for other in inputs:
            if path.exists() and os.path.exists(other) and path.samefile(other):
                raise Failure(USAGE, f"{option} {path}: would write over the input {other}")
    if len({path.resolve() for path in outputs.values()}) < len(outputs):
        raise Failure(USAGE, f"{' and '.join(outputs)} name the same file")


def write_file(path, data, mode=0o666):
    # Replaces the file by `data`. `mode` and the umask are those of a new file; one that is replaced passes its permissions on.
    path = pathlib.Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as out:
            if path.exists():
                os.fchmod(out.fileno(), path.stat().st_mode & 0o777)
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise Failure(UNWRITABLE, f"{path}: {error.strerror}") from error


def run(prog, main):
    # Calls main(words of the command line) and ends the process.
    try:
        main(sys.argv[1:])
        sys.exit(0)
    except Failure as failure:
        code, message = failure.code, str(failure)
    except OSError as error:
        code, message = REFUSED, f"{error.filename}: {error.strerror}"
    except KeyboardInterrupt:
        code, message = REFUSED, "stopped; nothing was written"
    print(f"{prog}: {''.join(c if c.isprintable() else '?' for c in message)}", file=sys.stderr)
    sys.exit(code)
