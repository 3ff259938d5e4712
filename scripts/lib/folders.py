# SPDX-License-Identifier: Apache-2.0
"""folders.py SOURCE [--check]: the folders of the product's code, which of them include which, and the picture of that
in ARCHITECTURE.md. tests/dependency_rule_test.py uses it too.

The rule: a folder includes only folders that stand before it in FOLDERS_IN_ORDER. The edges come from the #include lines
of the sources, each of which must name a file by its full path, so that none is missed."""
import graphlib
import os
import pathlib
import re
import sys

# From the lowest layer up.
FOLDERS_IN_ORDER = (
    "formats/base", "formats/geometry", "formats/asset", "formats/session", "formats/session/scene_reading", "formats/examples",
    "pipeline/base", "pipeline/read", "pipeline/read/image", "pipeline/read/nifti", "pipeline/read/nrrd", "pipeline/read/dicom", "pipeline/open",
    "pipeline/segment", "pipeline/contour", "pipeline/triangulation", "pipeline/verify", "pipeline/surface", "pipeline/scan",
    "pipeline/preview", "pipeline/farm", "pipeline/archive", "pipeline/review", "pipeline/program/archive", "pipeline/program",
    "runtime/sheet_mesh", "runtime/hole_cutting", "runtime/local_refinement", "runtime/realtime", "runtime/decompositions", "runtime/device", "runtime/mechanism", "runtime/pose_device", "runtime/contact",
    "runtime/bone_cutting/law", "runtime/bone_cutting/material", "runtime/bone_cutting/contact", "runtime/deformation",
    "runtime/link", "runtime/connection", "runtime/simulation", "runtime/force_law", "runtime/workers", "runtime/control", "runtime/telemetry",
    "runtime/session", "runtime/devices", "runtime/checking", "runtime/reporting", "runtime/console/programs", "runtime/console/igtl", "runtime/console/answers", "runtime/console", "runtime/program",
)
PRODUCT = ("formats", "pipeline", "runtime")
OURS = PRODUCT + ("sample_ct", "tests")
GENERATED = "embedded/"  # headers that the build makes (scripts/cmake/embed_text.cmake)
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)
SYSTEM_INCLUDE = re.compile(r"^\s*#\s*include\s*<([^>]+)>", re.MULTILINE)
BEGIN, END = "<!-- folders: begin -->", "<!-- folders: end -->"


def units_of(source, folders):
    """{translation unit in `folders`: [what it includes, directly or through our headers]}. Our files are absolute paths; any other
    header is its name after a slash, as in "/CGAL/version.h"."""
    paths = {str(path.relative_to(source)): path for folder in OURS for path in sorted((source / folder).rglob("*")) if path.suffix in (".h", ".cpp")}
    text = {name: path.read_text(encoding="utf-8", errors="replace") for name, path in paths.items()}
    ours = {name: INCLUDE.findall(t) for name, t in text.items()}
    units = {}
    for name, path in paths.items():
        if path.suffix == ".cpp" and name.split("/")[0] in folders:
            reached = reachable(name, ours)
            units[path] = [paths[other] for other in sorted(reached) if other in paths]
            units[path] += ["/" + header for other in sorted(reached) for header in SYSTEM_INCLUDE.findall(text.get(other, ""))]
    return units


def reachable(name, lines):
    """The file and what it includes, directly or through others, by {file: [included file]}."""
    reached, waiting = {name}, [name]
    while waiting:
        for other in lines.get(waiting.pop(), ()):
            if other not in reached:
                reached.add(other)
                waiting.append(other)
    return reached


def top_folder(path, source):
    """The first part of a path inside the sources, or None."""
    return path.relative_to(source).parts[0] if path.is_relative_to(source) else None


def folder_of(name):
    """The folder of a file, named relative to the sources; None if FOLDERS_IN_ORDER lacks it."""
    folder = name.rpartition("/")[0]
    return folder if folder in FOLDERS_IN_ORDER else None


def include_lines(source):
    """{file: [included file]} of all headers and sources in PRODUCT, names relative to `source`."""
    lines = {}
    for folder in PRODUCT:
        for path in sorted((source / folder).rglob("*")):
            if path.suffix in (".h", ".cpp"):
                text = path.read_text(encoding="utf-8", errors="replace")
                lines[str(path.relative_to(source))] = INCLUDE.findall(text)
    return lines


def edges_of(lines):
    """{(folder, included folder): "FILE includes FILE" of the first such line}."""
    edges = {}
    for file, included in lines.items():
        for other in included:
            pair = folder_of(file), folder_of(other)
            if None not in pair and pair[0] != pair[1]:
                edges.setdefault(pair, f'{file} includes "{other}"')
    return edges


def circles(graph):
    """The circles of {node: [node it depends on]}, each as [a, b, ..., a]. Of each circle that is found, one edge is then left out, so
    that every circle contains an edge of a reported one."""
    graph = {node: set(others) - {node} for node, others in graph.items()}
    found = []
    while True:
        try:
            graphlib.TopologicalSorter(graph).prepare()
            return found
        except graphlib.CycleError as error:
            circle = error.args[1][::-1]  # each node depends on the one that follows
            graph[circle[0]].discard(circle[1])
            found.append(circle)


def check(lines, source):
    """What breaks the rule, as sentences: a file in an unlisted folder, an include against the order of FOLDERS_IN_ORDER, an include
    by another name than the file's full path, which would hide an edge."""
    broken = [f"{file}: its folder is missing in FOLDERS_IN_ORDER of scripts/lib/folders.py" for file in lines if folder_of(file) is None]
    for (folder, other), example in edges_of(lines).items():
        if FOLDERS_IN_ORDER.index(other) > FOLDERS_IN_ORDER.index(folder):
            broken.append(f"{folder} must not include {other}, which is above it: {example}")
    for file, included in lines.items():
        broken += [f"{file} includes {other}, which is no full path from the top folder" for other in included
                   if not other.startswith(GENERATED) and not (source / other).is_file()]
    return broken


def reduced(edges):
    """The edges without those that follow from a path of others. Needs edges that keep the order of FOLDERS_IN_ORDER."""
    below = {}
    for folder in FOLDERS_IN_ORDER:  # from the bottom, so that what is below is known
        direct = {other for a, other in edges if a == folder}
        below[folder] = direct | {far for other in direct for far in below[other]}
    return [(a, b) for a, b in sorted(edges, key=lambda edge: (-FOLDERS_IN_ORDER.index(edge[0]), -FOLDERS_IN_ORDER.index(edge[1])))
            if not any(b in below[c] for x, c in edges if x == a and c != b)]


def mermaid(edges):
    """A flowchart in Mermaid's text form, from the highest folder down."""
    existing = [folder for folder in FOLDERS_IN_ORDER if any(folder in edge for edge in edges)]
    lines = ["```mermaid", "flowchart TD"]
    for folder in reversed(PRODUCT):
        lines.append(f"  subgraph {folder}")
        for inner in reversed(existing):
            if inner.startswith(f"{folder}/"):
                lines.append(f"    {inner.replace('/', '_')}[\"{inner.partition('/')[2]}\"]")
        lines.append("  end")
    lines += [f"  {a} --> {b}".replace("/", "_") for a, b in reduced(edges)]
    return "\n".join([*lines, "```"])


def block(edges):
    return (f"{BEGIN}\n<!-- written by scripts/folders -->\n{mermaid(edges)}\n\nAn arrow points to a folder that is included. "
            f"A direct arrow is left out if a chain of other arrows leads to the same folder.\n{END}")


def replaced(text, edges):
    """The page with its block renewed; None if it has no marks."""
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    return f"{head}{block(edges)}{tail}" if begin and end else None


def main():
    check_only = "--check" in sys.argv
    source = pathlib.Path(next(a for a in sys.argv[1:] if a != "--check")).resolve()
    page = source / "ARCHITECTURE.md"
    lines = include_lines(source)
    broken = check(lines, source)
    if broken:
        print("\n".join(broken), file=sys.stderr)
        return 1
    text = page.read_text(encoding="utf-8") if page.exists() else ""
    renewed = replaced(text, edges_of(lines))
    if renewed is None:
        print(f"{page}: has no {BEGIN} ... {END}", file=sys.stderr)
        return 1
    if check_only:
        if renewed != text:
            print(f"{page}: the picture of the folders is out of date; scripts/folders renews it", file=sys.stderr)
        return int(renewed != text)
    if renewed != text:
        temporary = page.with_name(f".{page.name}.{os.getpid()}")
        temporary.write_text(renewed, encoding="utf-8")
        os.replace(temporary, page)
    print(f"{page}: {len(FOLDERS_IN_ORDER)} folders, {len(reduced(edges_of(lines)))} of {len(edges_of(lines))} arrows drawn, none upwards")
    return 0


if __name__ == "__main__":
    sys.exit(main())
