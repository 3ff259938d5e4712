# SPDX-License-Identifier: Apache-2.0
"""The folders of the product's code, and which of them include which; for tests/dependency_rule_test.py and clang_tidy.py.

The rule: a folder includes only folders that stand before it in FOLDERS_IN_ORDER. The edges come from the #include lines
of the sources, each of which must name a file by its full path, so that none is missed."""
import graphlib
import re

# From the lowest layer up.
FOLDERS_IN_ORDER = (
    "formats/base", "formats/geometry", "formats/asset", "formats/session", "formats/session/scene_reading", "formats/examples",
    "pipeline/base", "pipeline/read", "pipeline/read/image", "pipeline/read/nifti", "pipeline/read/nrrd", "pipeline/read/dicom", "pipeline/open",
    "pipeline/segment", "pipeline/contour", "pipeline/triangulation", "pipeline/verify", "pipeline/surface", "pipeline/scan",
    "pipeline/preview", "pipeline/farm", "pipeline/review", "pipeline/program",
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
