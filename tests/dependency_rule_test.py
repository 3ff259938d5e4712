# SPDX-License-Identifier: Apache-2.0
"""dependency_rule_test.py SOURCE BUILD [PROGRAM]: which folder may include which.

Read from the compiler's own dependency files (`ninja -t deps`), from the sources'
#include lines, and from what the dynamic linker loads for PROGRAM (trocar-run):

 1. formats includes neither pipeline nor runtime; pipeline and runtime never include
    each other; none of the three includes sample_ct or tests.
 2. formats and runtime include neither OpenCV nor CGAL nor GMP/MPFR nor Boost
    (runtime/console alone may use Boost); PROGRAM loads none of their libraries. No header
    of runtime reaches nlohmann/json, and of formats only FORMATS_JSON_HEADERS do.
 3. Only formats (and tests that look inside files) include tinygltf or Draco.
 4. Every source file carries the SPDX line of its folder: Apache-2.0, but
    GPL-3.0-or-later in pipeline/ and in tests that include pipeline or CGAL.

Every rule is first shown to fail on a made-up tree that breaks it.
"""
import json
import pathlib
import re
import subprocess
import sys
import tempfile

OURS = ("formats", "pipeline", "runtime", "sample_ct", "tests")
MAY_NOT_INCLUDE_FOLDER = {
    "formats": {"pipeline", "runtime", "sample_ct", "tests"},
    "pipeline": {"runtime", "sample_ct", "tests"},
    "runtime": {"pipeline", "sample_ct", "tests"},
    "sample_ct": {"tests"},
    "tests": set(),
}
LIBRARIES = {
    "OpenCV": re.compile(r"/opencv4?/|/opencv2/"),
    "CGAL": re.compile(r"/CGAL/"),
    "GMP/MPFR": re.compile(r"/(gmp|gmpxx|mpfr)\.h$"),
    "Boost": re.compile(r"/boost/"),
    "tinygltf": re.compile(r"/tiny_gltf\.h$"),
    "Draco": re.compile(r"/draco/"),
}
HEAVY = {"OpenCV", "CGAL", "GMP/MPFR", "Boost"}
MAY_NOT_INCLUDE_LIBRARY = {
    "formats": HEAVY,
    "pipeline": {"tinygltf", "Draco"},
    "runtime": HEAVY | {"tinygltf", "Draco"},
    "sample_ct": {"tinygltf", "Draco"},
    "tests": set(),
}
# The headers of formats that are for .cpp files that work on JSON.
FORMATS_JSON_HEADERS = {"formats/asset/gltf_writer.h", "formats/asset/slice_payload.h",
                        "formats/base/json_text.h", "formats/base/strict_json.h"}
FORBIDDEN_SHARED = re.compile(r"lib(opencv_\w+|gmp|gmpxx|mpfr|boost_\w+|CGAL\w*)\.so")
APACHE, GPL = "Apache-2.0", "GPL-3.0-or-later"
LICENSED = ("*.h", "*.cpp", "*.py", "*.mjs", "*.js", "*.cmake", "CMakeLists.txt")


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


def folder_of(path, source):
    """The folder of ours that an absolute path lies in, or None."""
    try:
        first = path.relative_to(source).parts[0]
    except ValueError:
        return None
    return first if first in OURS else None


def libraries_of(path):
    return {name for name, pattern in LIBRARIES.items() if pattern.search(path)}


def forbidden_libraries(source_name):
    forbidden = MAY_NOT_INCLUDE_LIBRARY[source_name.split("/")[0]]
    return forbidden - {"Boost"} if source_name.startswith("runtime/console/") else forbidden


def check_units(units, source):
    """Rules 1-3 on {translation unit: [absolute path of what it includes]}."""
    broken = []
    for unit, included in sorted(units.items()):
        name = str(unit.relative_to(source))
        owner = name.split("/")[0]
        for path in included:
            theirs = folder_of(path, source)
            if theirs in MAY_NOT_INCLUDE_FOLDER[owner]:
                broken.append(f"{name} includes {path.relative_to(source)}")
            if theirs is None:
                for library in sorted(libraries_of(str(path)) & forbidden_libraries(name)):
                    broken.append(f"{name} includes {library}: {path}")
    return broken


def check_include_lines(source):
    """Rule 1 once more on what is written, so that a header counts that no unit uses yet."""
    broken = []
    line = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)
    for folder in OURS:
        for pattern in ("*.h", "*.cpp"):
            for path in sorted((source / folder).rglob(pattern)):
                for name in line.findall(path.read_text(encoding="utf-8", errors="replace")):
                    if name.split("/")[0] in MAY_NOT_INCLUDE_FOLDER[folder]:
                        broken.append(f'{path.relative_to(source)} includes "{name}"')
    return broken


def check_json_headers(source):
    """Rule 2 for nlohmann/json, from the #include lines, so that every header is checked."""
    line = re.compile(r'^\s*#\s*include\s*(?:"([^"]+)"|<(nlohmann/[^>]+)>)', re.MULTILINE)

    def path_to_json(name):
        """[name, ..., nlohmann header], the shortest along #include lines; None if there is none."""
        paths, seen = [[name]], {name}
        for path in paths:  # grows while it is read: breadth first
            file = source / path[-1]
            text = file.read_text(encoding="utf-8", errors="replace") if file.is_file() else ""
            for ours, json_header in line.findall(text):
                if json_header:
                    return path + [json_header]
                if ours not in seen:
                    seen.add(ours)
                    paths.append(path + [ours])
        return None

    broken = []
    for folder, allowed in (("runtime", set()), ("formats", FORMATS_JSON_HEADERS)):
        for path in sorted((source / folder).rglob("*.h")):
            name = str(path.relative_to(source))
            found = path_to_json(name)
            if found and name not in allowed:
                broken.append(f"{name} reaches nlohmann/json: {' -> '.join(found)}")
    return broken


def check_licences(source, units):
    """Rule 4. `units` tells which tests reach pipeline or CGAL."""
    broken = []
    gpl_tests = {unit for unit, included in units.items()
                 if folder_of(unit, source) == "tests" and any(
                     folder_of(path, source) == "pipeline" or "CGAL" in libraries_of(str(path))
                     for path in included)}
    scripts = [p for p in sorted((source / "scripts").rglob("*")) if p.is_file() and p.suffix == ""]
    files = scripts + [source / "CMakeLists.txt"]
    for folder in OURS + ("scripts",):
        for pattern in LICENSED:
            files += sorted((source / folder).rglob(pattern))
    for path in files:
        name = path.relative_to(source)
        if not path.is_file() or {"node_modules", "__pycache__"} & set(name.parts):
            continue
        text = path.read_text(encoding="utf-8", errors="replace")
        wanted = GPL if name.parts[0] == "pipeline" or path in gpl_tests else APACHE
        head = "\n".join(text.splitlines()[:2])
        found = re.search(r"SPDX-License-Identifier: (\S+)", head)
        if not found:
            broken.append(f"{name} has no SPDX line at its top (expected {wanted})")
        elif name.parts[0] == "tests" and path.suffix in (".h", ".cpp") and path not in units:
            continue  # not a unit of this build: what it reaches is not known
        elif found[1] != wanted:
            broken.append(f"{name} is marked {found[1]}, expected {wanted}")
    return broken


def check_program(ldd_output, program):
    return [f"{program} loads {line.strip()}" for line in ldd_output.splitlines()
            if FORBIDDEN_SHARED.search(line)]


def units_from(deps_text, commands, source, build):
    """{our translation unit: [what it includes]}, and our units that have no deps yet."""
    deps = parse_deps(deps_text)
    units, unbuilt = {}, []
    for entry in commands:
        unit = pathlib.Path(entry["file"])
        if folder_of(unit, source) is None or unit.is_relative_to(build):
            continue
        files = deps.get(entry["output"])
        if files is None:
            unbuilt.append(str(unit.relative_to(source)))
            continue
        # normpath, not resolve: a system header must not lose its name through a link.
        paths = [pathlib.Path(build, f) for f in files]
        paths = [p if ".." not in p.parts else p.resolve() for p in paths]
        units.setdefault(unit, []).extend(paths)
    return units, unbuilt


def self_check():
    """A made-up project that breaks each rule once; each must be found, and nothing else."""
    with tempfile.TemporaryDirectory() as folder:
        source = pathlib.Path(folder).resolve()
        build = source / "build" / "x"
        build.mkdir(parents=True)
        cases = {  # unit: (what it includes, the complaint it must raise or None)
            "formats/a.cpp": (["../../runtime/r.h"], "formats/a.cpp includes runtime/r.h"),
            "formats/b.cpp": (["/usr/include/gmp.h"], "formats/b.cpp includes GMP/MPFR"),
            "formats/ok.cpp": (["../../formats/f.h", "/usr/include/draco/x.h",
                                "/usr/include/tiny_gltf.h"], None),
            "pipeline/a.cpp": (["../../runtime/r.h"], "pipeline/a.cpp includes runtime/r.h"),
            "pipeline/b.cpp": (["/usr/include/draco/x.h"], "pipeline/b.cpp includes Draco"),
            "pipeline/ok.cpp": (["/usr/include/CGAL/x.h", "/usr/include/boost/x.hpp"], None),
            "runtime/a.cpp": (["../../pipeline/p.h"], "runtime/a.cpp includes pipeline/p.h"),
            "runtime/b.cpp": (["/usr/include/opencv4/opencv2/core.hpp"], "runtime/b.cpp includes OpenCV"),
            "runtime/c.cpp": (["/usr/include/CGAL/x.h"], "runtime/c.cpp includes CGAL"),
            "runtime/d.cpp": (["/usr/include/boost/x.hpp"], "runtime/d.cpp includes Boost"),
            "runtime/e.cpp": (["/usr/include/tiny_gltf.h"], "runtime/e.cpp includes tinygltf"),
            "runtime/console/ok.cpp": (["/usr/include/boost/beast.hpp"], None),
            "tests/ok.cpp": (["../../pipeline/p.h", "../../runtime/r.h"], None),
        }
        listing, commands = "", []
        for name, (included, _) in cases.items():
            path = source / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"// SPDX-License-Identifier: {APACHE}\n")
            commands.append({"file": str(path), "output": f"{name}.o"})
            listing += f"{name}.o: #deps {len(included)}, deps mtime 1 (VALID)\n"
            listing += "".join(f"    {f}\n" for f in included) + "\n"
        commands.append({"file": str(source / "formats/unbuilt.cpp"), "output": "unbuilt.o"})
        (source / "pipeline/p.h").write_text(f"// SPDX-License-Identifier: {GPL}\n")
        (source / "runtime/r.h").write_text('#include "pipeline/p.h"\n')
        (source / "scripts").mkdir()
        (source / "CMakeLists.txt").write_text(f"# SPDX-License-Identifier: {APACHE}\n")

        units, unbuilt = units_from(listing, commands, source, build)
        assert unbuilt == ["formats/unbuilt.cpp"], unbuilt
        found = check_units(units, source)
        for complaint in filter(None, (c for _, c in cases.values())):
            assert sum(f.startswith(complaint) for f in found) == 1, (complaint, found)
        assert len(found) == sum(c is not None for _, c in cases.values()), found
        assert check_include_lines(source) == ['runtime/r.h includes "pipeline/p.h"']

        (source / "formats/base").mkdir()
        (source / "formats/base/json_text.h").write_text("#include <nlohmann/json.hpp>\n")
        (source / "formats/asset.h").write_text("#include <nlohmann/json_fwd.hpp>\n")
        (source / "formats/f.h").write_text('#include "formats/g.h"\n')
        (source / "formats/g.h").write_text('#include "formats/f.h"\n')
        (source / "runtime/s.h").write_text('#include "runtime/t.h"\n')
        (source / "runtime/t.h").write_text('#include "formats/f.h"\n'
                                            '#include "formats/base/json_text.h"\n')
        assert check_json_headers(source) == [
            "runtime/s.h reaches nlohmann/json: runtime/s.h -> runtime/t.h -> "
            "formats/base/json_text.h -> nlohmann/json.hpp",
            "runtime/t.h reaches nlohmann/json: runtime/t.h -> "
            "formats/base/json_text.h -> nlohmann/json.hpp",
            "formats/asset.h reaches nlohmann/json: formats/asset.h -> nlohmann/json_fwd.hpp"]
        for name in ("s", "t"):
            (source / f"runtime/{name}.h").unlink()
        for name in ("base/json_text", "asset", "f", "g"):
            (source / f"formats/{name}.h").unlink()

        licences = check_licences(source, units)
        assert any(f.startswith("pipeline/a.cpp is marked Apache-2.0") for f in licences), licences
        assert any(f.startswith("runtime/r.h has no SPDX line") for f in licences), licences
        assert any(f.startswith("tests/ok.cpp is marked Apache-2.0") for f in licences), licences
        assert not any(f.startswith("formats/") for f in licences), licences
    loaded = "\tlibc.so.6 => x\n\tlibgmp.so.10 => x\n\tlibopencv_core.so.406 => x\n\tlibboost_log.so.1 => x\n"
    assert len(check_program(loaded, "p")) == 3


def main():
    if len(sys.argv) not in (3, 4):
        print("usage: dependency_rule_test.py SOURCE BUILD [PROGRAM]", file=sys.stderr)
        return 2
    self_check()
    source, build = (pathlib.Path(a).resolve() for a in sys.argv[1:3])
    listing = subprocess.run(["ninja", "-C", str(build), "-t", "deps"], check=True,
                             stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
    commands = json.loads((build / "compile_commands.json").read_text())
    for entry in commands:
        if "output" not in entry:  # older CMake leaves it out
            entry["output"] = re.search(r" -o (\S+) ", entry["command"])[1]
    units, unbuilt = units_from(listing, commands, source, build)
    broken = [f"{name} has not been built: build everything first" for name in unbuilt]
    for folder in ("formats", "pipeline", "runtime"):
        if not any(folder_of(unit, source) == folder for unit in units):
            broken.append(f"no translation unit of {folder}/ found: the check would be empty")
    broken += check_units(units, source) + check_include_lines(source)
    broken += check_licences(source, units)
    if len(sys.argv) == 4:
        program = sys.argv[3]
        loaded = subprocess.run(["ldd", program], check=True, stdout=subprocess.PIPE, text=True)
        broken += check_program(loaded.stdout, program)
    broken += check_json_headers(source)
    for line in broken:
        print(line)
    print(f"{len(units)} translation units, {len(broken)} broken rules")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
