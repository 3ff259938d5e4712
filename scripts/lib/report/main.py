# SPDX-License-Identifier: Apache-2.0
"""main.py [OPTIONS]: runs the report's sections and writes report.json and index.html.

A section is one file of sections/ with
    TITLE, ORDER             its heading, and its place on the page
    measure(context) -> {}   runs programs and returns the section's part of report.json: every number has
                             its unit in its name, every row of a list has an "id"
    show(data, page)         adds tables and plots of these data to the page; measures nothing
    results(data) -> [str]   its lines for tests/bench/RESULTS.md
    headline(data) -> str    (optional) its most important figure in a sentence, for README.md
"""
import argparse
import dataclasses
import datetime
import importlib
import json
import os
import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent.parent / "plots")]

import against  # noqa: E402
import machine  # noqa: E402
import results  # noqa: E402

SCHEMA = 1
SECTION_NAMES = sorted(path.stem for path in (HERE / "sections").glob("*.py") if path.stem != "__init__")


@dataclasses.dataclass
class Context:
    """What a section's measure() may use."""
    full: bool
    programs: pathlib.Path  # folder of the built programs
    sample: pathlib.Path    # the sample scan: png/, dicom/, sample.nii.gz
    scratch: pathlib.Path   # for the section's temporary files
    head_ct: pathlib.Path | None
    real_ct: pathlib.Path | None


def existing(path):
    return pathlib.Path(path) if path and pathlib.Path(path).exists() else None


def write(path, text):
    """Writes the complete file or none."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)
    print(path)


def arguments():
    parser = argparse.ArgumentParser(usage=argparse.SUPPRESS, allow_abbrev=False)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--quick", action="store_true")
    form.add_argument("--full", action="store_true")
    parser.add_argument("--only", action="append", choices=SECTION_NAMES)
    parser.add_argument("--against", type=pathlib.Path)
    parser.add_argument("--page", "--readme", dest="page", action="store_true")
    parser.add_argument("--check", action="store_true")  # checks these arguments and ends
    parser.add_argument("--redraw", action="store_true")  # index.html from the existing report.json
    for name in ("--root", "--bin", "--sample", "--out"):
        parser.add_argument(name, type=pathlib.Path)
    given = parser.parse_args()
    if given.page and given.only:
        parser.error("--page needs every section")
    if given.against is not None:
        try:
            given.against = (given.against.name, json.loads(given.against.read_text()))
            assert given.against[1]["schema"] == SCHEMA
        except (OSError, ValueError, KeyError, TypeError, AssertionError):
            parser.error(f"--against: not a report of schema {SCHEMA}")
    return given


def measure(given, sections):
    scratch = given.out / ".scratch"
    scratch.mkdir(parents=True, exist_ok=True)
    context = Context(given.full, given.bin, given.sample, scratch,
                      existing(os.environ.get("TROCAR_HEAD_CT")), existing(os.environ.get("TROCAR_REAL_CT")))
    report = {
        "schema": SCHEMA, "form": "full" if given.full else "quick",
        "made": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        "machine": machine.describe(), "versions": machine.versions(given.root, given.bin), "sections": {},
    }
    for name, section in sections.items():
        print(f"report: measuring {section.TITLE}", file=sys.stderr)
        report["sections"][name] = section.measure(context)
    report["machine"]["load_average_at_end"] = os.getloadavg()[0]
    return report


def write_into_sources(root, report, sections):
    """tests/bench/RESULTS.md, README.md's headlines and their plot."""
    import pipeline_plots
    from style import save_plain

    measured = {name: report["sections"][name] for name in sections if name in report["sections"]}
    sentence = machine.sentence(report)
    results.write_page(root / "tests" / "bench" / "RESULTS.md", sentence,
                       [(sections[name].TITLE, sections[name].results(data)) for name, data in measured.items()])
    results.update_readme(root / "README.md", sentence,
                          [sections[name].headline(data) for name, data in measured.items() if hasattr(sections[name], "headline")])
    save_plain(pipeline_plots.headline(sections["pipeline"].chosen_rows(measured["pipeline"])), root / results.PICTURE)


def main():
    given = arguments()
    if given.check:
        return
    sections = {name: importlib.import_module(f"sections.{name}") for name in given.only or SECTION_NAMES}
    sections = dict(sorted(sections.items(), key=lambda item: item[1].ORDER))
    given.out.mkdir(parents=True, exist_ok=True)
    if given.redraw:
        report = json.loads((given.out / "report.json").read_text())
    else:
        report = measure(given, sections)
        write(given.out / "report.json", json.dumps(report, indent=1) + "\n")

    import page as html  # imports matplotlib, which takes time: wrong arguments are reported before
    page = html.Page("Trocar: speed against error")
    machine.show(report, page)
    if given.against is not None:
        against.show(*given.against, report, page)
    for name, section in sections.items():
        if name in report["sections"]:
            page.section(section.TITLE)
            section.show(report["sections"][name], page)
    write(given.out / "index.html", page.text())
    if given.page:
        write_into_sources(given.root, report, sections)


if __name__ == "__main__":
    main()
