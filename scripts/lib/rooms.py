# SPDX-License-Identifier: Apache-2.0
"""rooms.py SOURCE BUILD [--check]: the rooms (folders) of the product's code, which of them include which, and the picture of that
in ARCHITECTURE.md. tests/dependency_rule_test.py uses it too.

The rule: a room includes only rooms that stand before it in ROOMS. The edges come from the #include lines
of the sources; the compiler's dependency files (`ninja -t deps`) show that none was missed."""
import json
import os
import pathlib
import re
import subprocess
import sys

# From the lowest layer up. `pipeline` and `runtime` are the files at the top of these folders.
ROOMS = (
    "formats/base", "formats/geometry", "formats/asset", "formats/session", "formats/examples",
    "pipeline/read", "pipeline/contour", "pipeline/solid", "pipeline/mesh", "pipeline/farm",
    "pipeline",
    "runtime/mesh", "runtime/cut", "runtime/refine", "runtime/device", "runtime/mechanism", "runtime/contact", "runtime/cutting",
    "runtime/deformation",
    "runtime/link", "runtime/simulation", "runtime/realtime", "runtime/control", "runtime/session", "runtime/console", "runtime",
)
FOLDERS = ("formats", "pipeline", "runtime")
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)
BEGIN, END = "<!-- rooms: begin -->", "<!-- rooms: end -->"


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


def room_of(name):
    """The room of a file, named relative to the sources; None outside FOLDERS or in an unknown room."""
    folder = name.rpartition("/")[0]
    return folder if folder in ROOMS else None


def include_lines(source):
    """{file: [included file]} of all headers and sources in FOLDERS, names relative to `source`."""
    lines = {}
    for folder in FOLDERS:
        for path in sorted((source / folder).rglob("*")):
            if path.suffix in (".h", ".cpp"):
                text = path.read_text(encoding="utf-8", errors="replace")
                lines[str(path.relative_to(source))] = INCLUDE.findall(text)
    return lines


def edges_of(lines):
    """{(room, included room): "FILE includes FILE" of the first such line}."""
    edges = {}
    for file, included in lines.items():
        for other in included:
            pair = room_of(file), room_of(other)
            if None not in pair and pair[0] != pair[1]:
                edges.setdefault(pair, f'{file} includes "{other}"')
    return edges


def check(lines, units, source):
    """What breaks the rule, as sentences: a file in no room, an include against the order of ROOMS, an include that
    no #include line of ours explains."""
    broken = [f"{file} is in no room of scripts/lib/rooms.py" for file in lines if room_of(file) is None]
    for (room, other), example in edges_of(lines).items():
        if ROOMS.index(other) > ROOMS.index(room):
            broken.append(f"{room} must not include {other}, which is above it: {example}")
    for unit, included in sorted(units.items()):
        name = str(unit.relative_to(source))
        reached, waiting = {name}, [name]
        while waiting:
            for other in lines.get(waiting.pop(), ()):
                if other not in reached:
                    reached.add(other)
                    waiting.append(other)
        for path in included:
            if top_folder(path, source) in FOLDERS and str(path.relative_to(source)) not in reached:
                broken.append(f"{name} depends on {path.relative_to(source)}, which no include line names by its full path")
    return broken


def reduced(edges):
    """The edges without those that follow from a path of others. Needs edges that keep the order of ROOMS."""
    below = {}
    for room in ROOMS:  # from the bottom, so that what is below is known
        direct = {other for a, other in edges if a == room}
        below[room] = direct | {far for other in direct for far in below[other]}
    return [(a, b) for a, b in sorted(edges, key=lambda edge: (-ROOMS.index(edge[0]), -ROOMS.index(edge[1])))
            if not any(b in below[c] for x, c in edges if x == a and c != b)]


def mermaid(edges):
    """A flowchart in Mermaid's text form, from the highest room down."""
    def identifier(room):
        return room.replace("/", "_") if "/" in room else f"{room}_top"

    lines = ["```mermaid", "flowchart TD"]
    for folder in reversed(FOLDERS):
        lines.append(f"  subgraph {folder}")
        for room in reversed(ROOMS):
            if room.split("/")[0] == folder:
                label = room.partition("/")[2] or ("programs" if folder == "runtime" else "program and batch")
                lines.append(f"    {identifier(room)}[\"{label}\"]")
        lines.append("  end")
    lines += [f"  {identifier(a)} --> {identifier(b)}" for a, b in reduced(edges)]
    return "\n".join([*lines, "```"])


def block(edges):
    return (f"{BEGIN}\n<!-- written by scripts/rooms -->\n{mermaid(edges)}\n\nAn arrow points to a room that is included. "
            f"Arrows that follow from a path of others are left out.\n{END}")


def replaced(text, edges):
    """The page with its block renewed; None if it has no marks."""
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    return f"{head}{block(edges)}{tail}" if begin and end else None


def main():
    check_only = "--check" in sys.argv
    source, build = (pathlib.Path(a).resolve() for a in [a for a in sys.argv[1:] if a != "--check"])
    page = source / "ARCHITECTURE.md"
    units, unbuilt = units_of(*read_build(build), source, build, FOLDERS)
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
            print(f"{page}: the picture of the rooms is out of date; scripts/rooms renews it", file=sys.stderr)
        return int(renewed != text)
    if renewed != text:
        temporary = page.with_name(f".{page.name}.{os.getpid()}")
        temporary.write_text(renewed, encoding="utf-8")
        os.replace(temporary, page)
    print(f"{page}: {len(ROOMS)} rooms, {len(reduced(edges_of(lines)))} of {len(edges_of(lines))} arrows drawn, none upwards")
    return 0


if __name__ == "__main__":
    sys.exit(main())
