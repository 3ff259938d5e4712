# SPDX-License-Identifier: Apache-2.0
"""folders.py SOURCE BUILD [--check]: the folders of the product's code, which of them include which, and the picture of that
in ARCHITECTURE.md. tests/dependency_rule_test.py uses it too.

The rule: a folder includes only folders that stand before it in FOLDERS_IN_ORDER. The edges come from the #include lines
of the sources; the compiler's dependency files (`ninja -t deps`) show that none was missed."""
import graphlib
import json
import os
import pathlib
import re
import subprocess
import sys

# From the lowest layer up.
FOLDERS_IN_ORDER = (
    "formats/base", "formats/geometry", "formats/asset", "formats/session", "formats/examples",
    "pipeline/base", "pipeline/read", "pipeline/read/image", "pipeline/read/nifti", "pipeline/read/dicom", "pipeline/open",
    "pipeline/segment", "pipeline/contour", "pipeline/triangulation", "pipeline/verify", "pipeline/surface", "pipeline/scan",
    "pipeline/preview", "pipeline/farm", "pipeline/review", "pipeline/program",
    "runtime/sheet_mesh", "runtime/hole_cutting", "runtime/local_refinement", "runtime/device", "runtime/mechanism", "runtime/contact",
    "runtime/bone_cutting/law", "runtime/bone_cutting/material", "runtime/bone_cutting/contact", "runtime/deformation",
    "runtime/link", "runtime/simulation", "runtime/realtime", "runtime/force_law", "runtime/workers", "runtime/control", "runtime/telemetry",
    "runtime/session", "runtime/checking", "runtime/reporting", "runtime/console", "runtime/program",
)
PRODUCT = ("formats", "pipeline", "runtime")
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)
BEGIN, END = "<!-- folders: begin -->", "<!-- folders: end -->"


def parse_deps(text):
    """`ninja -t deps` as {object: [file, ...]}."""
    deps, current = {}, None
    for line in text.splitlines():
        if line.startswith("    "):
            deps[current].append(line.strip())
        elif "#deps" in line:
            current = line.split(": #deps")[0]
            deps[current] = []
    return deps


def read_build(build):
    """The output of `ninja -t deps` and the compile commands, each with its "output"."""
    listing = subprocess.run(["ninja", "-C", str(build), "-t", "deps"], check=True,
                             stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
    commands = json.loads((build / "compile_commands.json").read_text())
    for entry in commands:
        if "output" not in entry:  # older CMake leaves it out
            entry["output"] = re.search(r" -o (\S+) ", entry["command"])[1]
    return listing, commands


def units_of(deps_text, commands, source, build, folders):
    """{translation unit in `folders`: [absolute path of what it includes]}, and the units of which no target has been built."""
    deps = parse_deps(deps_text)
    units, unbuilt = {}, set()
    for entry in commands:
        unit = pathlib.Path(entry["file"])
        if top_folder(unit, source) not in folders or unit.is_relative_to(build):
            continue
        files = deps.get(entry["output"])
        if files is None:
            unbuilt.add(unit)
            continue
        # normpath, not resolve: a system header must not lose its name through a link.
        paths = [pathlib.Path(build, f) for f in files]
        paths = [p if ".." not in p.parts else p.resolve() for p in paths]
        units.setdefault(unit, []).extend(paths)
    return units, sorted(str(unit.relative_to(source)) for unit in unbuilt - units.keys())


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


def check(lines, units, source):
    """What breaks the rule, as sentences: a file in an unlisted folder, an include against the order of FOLDERS_IN_ORDER, an include that
    no #include line of ours explains."""
    broken = [f"{file}: its folder is missing in FOLDERS_IN_ORDER of scripts/lib/folders.py" for file in lines if folder_of(file) is None]
    for (folder, other), example in edges_of(lines).items():
        if FOLDERS_IN_ORDER.index(other) > FOLDERS_IN_ORDER.index(folder):
            broken.append(f"{folder} must not include {other}, which is above it: {example}")
    for unit, included in sorted(units.items()):
        name = str(unit.relative_to(source))
        reached, waiting = {name}, [name]
        while waiting:
            for other in lines.get(waiting.pop(), ()):
                if other not in reached:
                    reached.add(other)
                    waiting.append(other)
        for path in included:
            if top_folder(path, source) in PRODUCT and str(path.relative_to(source)) not in reached:
                broken.append(f"{name} depends on {path.relative_to(source)}, which no include line names by its full path")
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
            f"An arrow is left out if other arrows already lead there.\n{END}")


def replaced(text, edges):
    """The page with its block renewed; None if it has no marks."""
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    return f"{head}{block(edges)}{tail}" if begin and end else None


def main():
    check_only = "--check" in sys.argv
    source, build = (pathlib.Path(a).resolve() for a in [a for a in sys.argv[1:] if a != "--check"])
    page = source / "ARCHITECTURE.md"
    units, unbuilt = units_of(*read_build(build), source, build, PRODUCT)
    lines = include_lines(source)
    broken = [f"{name} has not been built: build everything first" for name in unbuilt] + check(lines, units, source)
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
