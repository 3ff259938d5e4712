# SPDX-License-Identifier: Apache-2.0
"""dependency_rule_test.py SOURCE BUILD [PROGRAM]: which folder may include which.

Read from the compiler's dependency files (`ninja -t deps`), from the sources'
#include lines, and from what the dynamic linker loads for PROGRAM (trocar-run):

 1. formats includes neither pipeline nor runtime; pipeline and runtime never include
    each other; none of the three includes sample_ct or tests.
 2. formats and runtime include neither OpenCV nor CGAL nor GMP/MPFR nor Boost
    (runtime/console alone may use Boost); PROGRAM loads none of their libraries. No header
    of runtime reaches nlohmann/json, and of formats only FORMATS_JSON_HEADERS do.
 3. Only formats (and tests that look inside files) include tinygltf or Draco.
 4. Every source file carries the SPDX line of its folder: Apache-2.0, but
    GPL-3.0-or-later in pipeline/ and in tests that include pipeline or CGAL.
 5. A room (sub-folder) of formats, pipeline and runtime includes only rooms that stand
    before it in scripts/lib/rooms.py, so that no include runs back up; the picture of
    the rooms in ARCHITECTURE.md is up to date.

A self-check first shows that every rule fails on a made-up tree that breaks it.
"""
import pathlib
import re
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "scripts" / "lib"))
import rooms  # noqa: E402

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


def folder_of(path, source):
    """The folder of OURS that an absolute path lies in, or None."""
    first = rooms.top_folder(path, source)
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
    """Rule 1 on the include lines, so that a header that no unit uses yet is checked too."""
    broken = []
    for folder in OURS:
        for pattern in ("*.h", "*.cpp"):
            for path in sorted((source / folder).rglob(pattern)):
                for name in rooms.INCLUDE.findall(path.read_text(encoding="utf-8", errors="replace")):
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
    """Rule 4. `units` shows which tests include pipeline or CGAL, directly or not."""
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
        if not path.is_file() or {"node_modules", "vendor", "__pycache__"} & set(name.parts):
            continue
        text = path.read_text(encoding="utf-8", errors="replace")
        wanted = GPL if name.parts[0] == "pipeline" or path in gpl_tests else APACHE
        head = "\n".join(text.splitlines()[:2])
        found = re.search(r"SPDX-License-Identifier: (\S+)", head)
        if not found:
            broken.append(f"{name} has no SPDX line at its top (expected {wanted})")
        elif name.parts[0] == "tests" and path.suffix in (".h", ".cpp") and path not in units:
            continue  # not a unit of this build: what it includes is not known
        elif found[1] != wanted:
            broken.append(f"{name} is marked {found[1]}, expected {wanted}")
    return broken


def check_program(ldd_output, program):
    return [f"{program} loads {line.strip()}" for line in ldd_output.splitlines()
            if FORBIDDEN_SHARED.search(line)]


def units_from(deps_text, commands, source, build):
    """{our translation unit: [what it includes]}, and our units that have not been built."""
    return rooms.units_of(deps_text, commands, source, build, OURS)


def check_rooms(source, units):
    """Rule 5."""
    broken = rooms.check(rooms.include_lines(source), {unit: paths for unit, paths in units.items() if folder_of(unit, source) in rooms.FOLDERS}, source)
    page = source / "ARCHITECTURE.md"
    text = page.read_text(encoding="utf-8") if page.exists() else ""
    if not broken and rooms.replaced(text, rooms.edges_of(rooms.include_lines(source))) != text:
        broken.append("ARCHITECTURE.md: the picture of the rooms is missing or out of date; scripts/rooms renews it")
    return broken


def self_check_rooms():
    """A made-up tree with an include upwards, one in a circle, a file in no room and an include by a relative path."""
    with tempfile.TemporaryDirectory() as folder:
        source = pathlib.Path(folder).resolve()
        files = {
            "formats/base/result.h": "",
            "formats/geometry/lattice.h": '#include "formats/base/result.h"\n',
            "formats/asset/asset.h": '#include "formats/geometry/lattice.h"\n#include "formats/base/result.h"\n',
            "runtime/mesh/sheet.cpp": '#include "formats/asset/asset.h"\n#include <vector>\n',
        }

        def write(more):
            for name, text in {**files, **more}.items():
                path = source / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)
            return rooms.include_lines(source)

        unit = source / "runtime/mesh/sheet.cpp"
        units = {unit: [unit, source / "formats/asset/asset.h", source / "formats/base/result.h", pathlib.Path("/usr/include/vector")]}
        lines = write({})
        assert rooms.check(lines, units, source) == []
        edges = rooms.edges_of(lines)
        assert len(edges) == 4
        assert rooms.reduced(edges) == [("runtime/mesh", "formats/asset"), ("formats/asset", "formats/geometry"), ("formats/geometry", "formats/base")]
        picture = rooms.mermaid(edges)
        assert picture.count(" --> ") == 3 and "  runtime_mesh --> formats_asset\n" in picture
        page = f"before\n{rooms.BEGIN}\nold\n{rooms.END}\nafter\n"
        renewed = rooms.replaced(page, edges)
        assert picture in renewed and renewed.startswith("before\n") and renewed.endswith("\nafter\n") and "old" not in renewed
        assert rooms.replaced(renewed, edges) == renewed and rooms.replaced("no marks", edges) is None

        broken = rooms.check(write({"formats/base/result.h": '#include "formats/asset/asset.h"\n'}), units, source)
        assert len(broken) == 1 and broken[0].startswith("formats/base must not include formats/asset"), broken
        broken = rooms.check(write({"formats/geometry/lattice.h": '#include "formats/asset/asset.h"\n'}), {}, source)
        assert len(broken) == 1 and broken[0].startswith("formats/geometry must not include formats/asset"), broken
        broken = rooms.check(write({"runtime/mesh/sheet.cpp": '#include "../../formats/asset/asset.h"\n'}), units, source)
        assert broken and all(line.startswith("runtime/mesh/sheet.cpp depends on formats/") for line in broken), broken
        broken = rooms.check(write({"runtime/elsewhere/x.h": ""}), {}, source)
        assert broken == ["runtime/elsewhere/x.h is in no room of scripts/lib/rooms.py"], broken


def self_check():
    """A made-up project that breaks rules 1 to 4 once each; each must be found, and nothing else."""
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
    self_check_rooms()
    source, build = (pathlib.Path(a).resolve() for a in sys.argv[1:3])
    listing, commands = rooms.read_build(build)
    units, unbuilt = units_from(listing, commands, source, build)
    broken = [f"{name} has not been built: build everything first" for name in unbuilt]
    for folder in ("formats", "pipeline", "runtime"):
        if not any(folder_of(unit, source) == folder for unit in units):
            broken.append(f"no translation unit of {folder}/ found: the check would be empty")
    broken += check_units(units, source) + check_include_lines(source)
    broken += check_rooms(source, units) + check_licences(source, units)
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
