# SPDX-License-Identifier: Apache-2.0
"""draw_all.py [-- LABEL PLOT ARGUMENT...]...: prints each LABEL and runs PLOT.py of this folder with its arguments, all in one process,
because loading matplotlib takes longer than drawing most of the pictures. What a plot prints is shown only if it fails; then the later
ones are not drawn."""
import contextlib
import io
import itertools
import pathlib
import runpy
import sys
import traceback


def draw(plot, arguments):
    """Runs the plot as a program. False if it failed; then what it printed has been shown."""
    printed = io.StringIO()
    sys.argv = [f"{plot}.py", *arguments]
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            runpy.run_path(str(pathlib.Path(__file__).with_name(f"{plot}.py")), run_name="__main__")
    except SystemExit as end:
        if not end.code:
            return True
        if isinstance(end.code, str):
            print(end.code, file=printed)
    except Exception:
        traceback.print_exc(file=printed)
    else:
        return True
    print(printed.getvalue(), end="", file=sys.stderr)
    return False


def main():
    for is_separator, words in itertools.groupby(sys.argv[1:], lambda word: word == "--"):
        if is_separator:
            continue
        label, plot, *arguments = words
        print(f"demo: {label}", file=sys.stderr, flush=True)
        if not draw(plot, arguments):
            print(f"demo: failed: {plot}.py {' '.join(arguments)}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
