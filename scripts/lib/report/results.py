# SPDX-License-Identifier: Apache-2.0
"""What `scripts/report --page` writes into the sources: tests/bench/RESULTS.md, and in README.md the headline figures
between two marks."""
import os

BEGIN, END = "<!-- report: begin -->", "<!-- report: end -->"
PICTURE = "scripts/plots/results.png"
HEADLINES = 5


def write(path, text):
    """Writes the complete file or none."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)
    print(path)


def spaced(lines):
    """The lines with an empty one before each table, as Markdown needs it."""
    out = []
    for line in lines:
        if line.startswith("|") and out and out[-1] and not out[-1].startswith("|"):
            out.append("")
        out.append(line)
    return out


def write_page(path, sentence, sections):
    """`sections`: [(title, lines)]."""
    lines = ["# Results of scripts/report", "", "Written by `scripts/report --page`; not edited otherwise. Plots and all figures: `out/report/index.html` of a run.",
             "", f"Measured: {sentence}."]
    for title, section_lines in sections:
        lines += ["", f"## {title}", "", *spaced(section_lines)]
    write(path, "\n".join(lines) + "\n")


def update_readme(path, sentence, headlines):
    """Replaces what stands between the marks."""
    text = path.read_text(encoding="utf-8")
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end:
        raise SystemExit(f"{path}: has no {BEGIN} ... {END}")
    body = "\n".join([*(f"- {line}" for line in headlines), "",
                      f"![For each scan and contouring method: the outlines' mean distance from the reference, and the time per slice. The reference of the synthetic CT is its exact cross-section. The reference of a real scan is its sub-pixel outline at full resolution, before simplification]({PICTURE})", "",
                      f"All results: [tests/bench/RESULTS.md](tests/bench/RESULTS.md). (From `scripts/report`: {sentence}.)"])
    write(path, f"{head}{begin}\n{body}\n{end}{tail}")
