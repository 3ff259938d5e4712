# SPDX-License-Identifier: Apache-2.0
"""Which folder may include which.

Read from the sources' #include lines, from the list of libraries that CMake writes (library_links.txt), and from
what the dynamic linker loads for trocar-run:

 1. formats includes neither pipeline nor runtime; pipeline and runtime never include
    each other; none of the three includes sample_ct or tests.
 2. formats and runtime include neither OpenCV nor CGAL nor GMP/MPFR nor Boost
    (runtime/connection and runtime/console alone may use Boost); trocar-run loads none of their libraries. No header
    of runtime reaches nlohmann/json, and of formats only FORMATS_JSON_HEADERS do.
 3. Only formats (and tests that look inside files) include tinygltf or Draco.
 4. Every source file carries the SPDX line of its folder: Apache-2.0, but
    GPL-3.0-or-later in pipeline/ and in tests that include pipeline or CGAL.
 5. A sub-folder of formats, pipeline and runtime includes only folders that stand
    before it in scripts/lib/folders.py, so that no include runs back up.
 6. No file includes itself through others, and no library links itself through others.
 7. The haptic loop, its force laws, its session and the checks of a scene work with any hand
    device: no file of ANY_DEVICE reaches the mechanism of one, not even through others.
 8. A program with a haptic loop links no library that is compiled with -Og. The linker keeps one copy
    of each inline function, and the loop would get that library's slow one.

For each rule, a test shows that it fails on a made-up tree that breaks it.
"""
import pathlib
import re
import subprocess

import folders
import pytest
from programs import BUILD, PROGRAMS, SOURCE

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
FORMATS_JSON_HEADERS = {"formats/asset/gltf_document.h", "formats/asset/hu_section.h",
                        "formats/asset/gltf_elements.h", "formats/asset/gltf_writer.h",
                        "formats/asset/slice_payload.h", "formats/asset/stated_entries.h",
                        "formats/base/json_text.h", "formats/base/strict_json.h",
                        "formats/session/scene_reading/scene_readers.h", "formats/session/assumed_values.h"}
ANY_DEVICE = ("runtime/contact/", "runtime/bone_cutting/", "runtime/force_law/", "runtime/control/", "runtime/telemetry/", "runtime/session/",
              "runtime/devices/pose_margins.", "runtime/devices/tip_workspace.", "runtime/devices/scene_hand.", "runtime/devices/live_hand.", "runtime/checking/")
ONE_DEVICE = ("runtime/mechanism/", "runtime/device/device.h", "runtime/link/", "runtime/simulation/")
SIMULATED_HAND = "runtime/simulation/hand.h"  # it moves the tool of any simulated device
LOOP_PROGRAMS = ("trocar-run", "trocar-device-sim")
FORBIDDEN_SHARED = re.compile(r"lib(opencv_\w+|gmp|gmpxx|mpfr|boost_\w+|CGAL\w*)\.so")
APACHE, GPL = "Apache-2.0", "GPL-3.0-or-later"
LICENSED = ("*.h", "*.cpp", "*.py", "*.mjs", "*.js", "*.cmake", "CMakeLists.txt")


def top_folder_of(path, source):
    """The folder of OURS that an absolute path lies in, or None."""
    first = folders.top_folder(path, source) if isinstance(path, pathlib.Path) else None
    return first if first in folders.OURS else None


def libraries_of(path):
    return {name for name, pattern in LIBRARIES.items() if pattern.search(path)}


def forbidden_libraries(source_name):
    forbidden = MAY_NOT_INCLUDE_LIBRARY[source_name.split("/")[0]]
    return forbidden - {"Boost"} if source_name.startswith(("runtime/connection/", "runtime/console/")) else forbidden


def check_units(units, source):
    """Rules 1-3 on the translation units of folders.units_of()."""
    broken = []
    for unit, included in sorted(units.items()):
        name = str(unit.relative_to(source))
        owner = name.split("/")[0]
        for path in included:
            theirs = top_folder_of(path, source)
            if theirs in MAY_NOT_INCLUDE_FOLDER[owner]:
                broken.append(f"{name} includes {path.relative_to(source)}")
            if theirs is None:
                for library in sorted(libraries_of(str(path)) & forbidden_libraries(name)):
                    broken.append(f"{name} includes {library}: {path}")
    return broken


def check_include_lines(source):
    """Rule 1 on the include lines, so that a header that no unit uses yet is checked too."""
    broken = []
    for folder in folders.OURS:
        for pattern in ("*.h", "*.cpp"):
            for path in sorted((source / folder).rglob(pattern)):
                for name in folders.INCLUDE.findall(path.read_text(encoding="utf-8", errors="replace")):
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
                 if top_folder_of(unit, source) == "tests" and any(
                     top_folder_of(path, source) == "pipeline" or "CGAL" in libraries_of(str(path))
                     for path in included)}
    scripts = [p for p in sorted((source / "scripts").rglob("*")) if p.is_file() and p.suffix == ""]
    files = scripts + [source / "CMakeLists.txt"]
    for folder in folders.OURS + ("scripts",):
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


def check_folders(source):
    """Rule 5."""
    lines = folders.include_lines(source)
    return folders.check(lines, source)


def libraries_linked(library_links):
    """{library or program: [library it links]} of "LIBRARY: ITEM ..." lines; an item may be a generator expression."""
    links = dict(line.split(": ", 1) for line in library_links.splitlines())
    return {name: [item for item in re.findall(r"[\w.+-]+", items) if item in links] for name, items in links.items()}


def check_circles(source, linked):
    """Rule 6. `linked` is from libraries_linked()."""
    return [f"circle of {kind}: {' -> '.join(circle)}" for kind, graph in (("includes", folders.include_lines(source)), ("libraries", linked))
            for circle in folders.circles(graph)]


def check_optimisation(source, linked):
    """Rule 8. The libraries compiled with -Og are those that a CMakeLists.txt gives to trocar_least_optimisation()."""
    lists = [path for folder in folders.PRODUCT for path in sorted((source / folder).rglob("CMakeLists.txt"))]
    least = {name for path in lists for names in re.findall(r"trocar_least_optimisation\(([^)]*)\)", path.read_text(encoding="utf-8"))
             for name in names.split()}
    assert least and least <= set(linked), f"none, or unknown libraries: {least - set(linked)}"
    return [f"{program} links {library}, which is compiled with -Og" for program in LOOP_PROGRAMS
            for library in sorted(folders.reachable(program, linked) & least)]


def check_any_device(source):
    """Rule 7."""
    lines = folders.include_lines(source)
    return [f"{name} reaches {other}" for name in sorted(lines) if name.startswith(ANY_DEVICE)
            for other in sorted(folders.reachable(name, lines)) if other.startswith(ONE_DEVICE) and other != SIMULATED_HAND]


def broken_rules(lines):
    """Fails with the broken rules, one a line."""
    assert not lines, "\n" + "\n".join(lines)


@pytest.fixture(scope="module", name="units")
def units_of_sources():
    """{translation unit of ours: [what it includes]}."""
    units = folders.units_of(SOURCE, folders.OURS)
    for folder in folders.PRODUCT:
        assert any(top_folder_of(unit, SOURCE) == folder for unit in units), f"no translation unit of {folder}/: the check would be empty"
    return units


def test_includes_of_units(units):
    broken_rules(check_units(units, SOURCE))


def test_include_lines():
    broken_rules(check_include_lines(SOURCE))


def test_json_headers():
    broken_rules(check_json_headers(SOURCE))


def test_licences(units):
    broken_rules(check_licences(SOURCE, units))


def test_order_of_folders():
    broken_rules(check_folders(SOURCE))


def test_any_device():
    broken_rules(check_any_device(SOURCE))


@pytest.fixture(scope="module", name="linked")
def linked_by_targets():
    return libraries_linked((BUILD / "library_links.txt").read_text())


def test_circles(linked):
    broken_rules(check_circles(SOURCE, linked))


def test_optimisation(linked):
    broken_rules(check_optimisation(SOURCE, linked))


def test_loaded_libraries():
    program = PROGRAMS / "trocar-run"
    broken_rules(check_program(subprocess.run(["ldd", program], check=True, stdout=subprocess.PIPE, text=True).stdout, program))


# Made-up trees that break the rules.


def write_tree(source, files):
    for name, text in files.items():
        path = source / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


ORDERED = {
    "formats/base/result.h": "",
    "formats/geometry/lattice.h": '#include "formats/base/result.h"\n',
    "formats/asset/asset.h": '#include "formats/geometry/lattice.h"\n#include "formats/base/result.h"\n',
    "runtime/sheet_mesh/sheet.cpp": '#include "formats/asset/asset.h"\n#include <vector>\n',
}


def test_any_device_finds_a_mechanism_behind_another_header(tmp_path):
    write_tree(tmp_path, {"runtime/mechanism/legs.h": "", "runtime/contact/tool.h": '#include "runtime/mechanism/legs.h"\n',
                          "runtime/control/loop.h": '#include "runtime/contact/tool.h"\n', "runtime/devices/open.h": '#include "runtime/mechanism/legs.h"\n',
                          "runtime/simulation/hand.h": "", "runtime/simulation/drive.h": "",
                          "runtime/checking/path.h": '#include "runtime/simulation/hand.h"\n#include "runtime/simulation/drive.h"\n'})
    assert check_any_device(tmp_path) == ["runtime/checking/path.h reaches runtime/simulation/drive.h",
                                          "runtime/contact/tool.h reaches runtime/mechanism/legs.h", "runtime/control/loop.h reaches runtime/mechanism/legs.h"]


@pytest.mark.parametrize("file, text, complaint", [
    ("formats/base/result.h", '#include "formats/asset/asset.h"\n', "formats/base must not include formats/asset"),
    ("formats/geometry/lattice.h", '#include "formats/base/result.h"\n#include "formats/asset/asset.h"\n', "formats/geometry must not include formats/asset"),
    ("pipeline/contour/x.h", '#include "pipeline/scan/y.h"\n', "pipeline/contour must not include pipeline/scan"),
    ("runtime/elsewhere/x.h", "", "runtime/elsewhere/x.h: its folder is missing"),
])
def test_broken_order_of_folders(tmp_path, file, text, complaint):
    write_tree(tmp_path, ORDERED)
    assert folders.check(folders.include_lines(tmp_path), tmp_path) == []
    write_tree(tmp_path, {file: text})
    broken = folders.check(folders.include_lines(tmp_path), tmp_path)
    assert broken[0].startswith(complaint), broken
    # An include by a relative path is an edge that the order of folders does not see.
    write_tree(tmp_path, {**ORDERED, file: ORDERED.get(file, ""), "runtime/sheet_mesh/sheet.cpp": '#include "../../formats/asset/asset.h"\n'})
    broken = folders.check(folders.include_lines(tmp_path), tmp_path)
    assert any(line.startswith("runtime/sheet_mesh/sheet.cpp includes ../../formats/") for line in broken), broken


def test_circles_are_found(tmp_path):
    write_tree(tmp_path, ORDERED)
    assert check_circles(tmp_path, libraries_linked("a: b;$<LINK_ONLY:c> zlib\nb: c\nc: NOTFOUND\n")) == []
    write_tree(tmp_path, {"formats/base/a.h": '#include "formats/base/b.h"\n', "formats/base/b.h": '#include "formats/base/c.h"\n',
                          "formats/base/c.h": '#include "formats/base/a.h"\n'})
    broken = check_circles(tmp_path, libraries_linked("a: b;$<LINK_ONLY:c> zlib\nb: \nc: $<$<CONFIG:Release>:a>\n"))
    assert len(broken) == 2, broken
    assert broken[0].startswith("circle of includes: ") and sorted(broken[0].split(" -> ")[1:]) == [f"formats/base/{x}.h" for x in "abc"], broken
    assert broken[1] in ("circle of libraries: a -> c -> a", "circle of libraries: c -> a -> c"), broken


def test_slow_library_is_found(tmp_path):
    write_tree(tmp_path, {"runtime/CMakeLists.txt": "trocar_little_optimisation(session)\ntrocar_least_optimisation(console\n  history)\n"})
    links = "trocar-run: session\ntrocar-device-sim: session\ntrocar-console: console\nsession: \nconsole: history;session\nhistory: \n"
    assert check_optimisation(tmp_path, libraries_linked(links)) == []
    assert check_optimisation(tmp_path, libraries_linked(links.replace("session: ", "session: $<LINK_ONLY:history>"))) == [
        "trocar-run links history, which is compiled with -Og", "trocar-device-sim links history, which is compiled with -Og"]


CASES = {  # unit: (its include lines, the complaint it must raise or None)
    "formats/a.cpp": (['"runtime/r.h"'], "formats/a.cpp includes runtime/r.h"),
    "formats/b.cpp": (["<gmp.h>"], "formats/b.cpp includes GMP/MPFR"),
    "formats/ok.cpp": (['"formats/f.h"', "<draco/x.h>", "<tiny_gltf.h>"], None),
    "pipeline/a.cpp": (['"runtime/s.h"'], "pipeline/a.cpp includes runtime/s.h"),
    "pipeline/b.cpp": (["<draco/x.h>"], "pipeline/b.cpp includes Draco"),
    "pipeline/ok.cpp": (["<CGAL/x.h>", "<boost/x.hpp>"], None),
    "runtime/a.cpp": (['"pipeline/p.h"'], "runtime/a.cpp includes pipeline/p.h"),
    "runtime/b.cpp": (["<opencv2/core.hpp>"], "runtime/b.cpp includes OpenCV"),
    "runtime/c.cpp": (["<CGAL/x.h>"], "runtime/c.cpp includes CGAL"),
    "runtime/d.cpp": (["<boost/x.hpp>"], "runtime/d.cpp includes Boost"),
    "runtime/e.cpp": (["<tiny_gltf.h>"], "runtime/e.cpp includes tinygltf"),
    "runtime/f.cpp": (['"runtime/cgal.h"'], "runtime/f.cpp includes CGAL"),
    "runtime/connection/ok.cpp": (["<boost/asio.hpp>"], None),
    "runtime/console/ok.cpp": (["<boost/beast.hpp>"], None),
    "tests/ok.cpp": (['"pipeline/p.h"', '"runtime/s.h"'], None),
}


@pytest.fixture(name="made_up")
def made_up_project(tmp_path):
    """The folder of a project of CASES, and its units."""
    for name, (included, _) in CASES.items():
        write_tree(tmp_path, {name: f"// SPDX-License-Identifier: {APACHE}\n" + "".join(f"#include {line}\n" for line in included)})
    write_tree(tmp_path, {"pipeline/p.h": f"// SPDX-License-Identifier: {GPL}\n", "runtime/r.h": "", "runtime/s.h": "", "formats/f.h": f"// SPDX-License-Identifier: {APACHE}\n",
                          "runtime/cgal.h": "#include <CGAL/x.h>\n",
                          "scripts/nothing.py": f"# SPDX-License-Identifier: {APACHE}\n",
                          "CMakeLists.txt": f"# SPDX-License-Identifier: {APACHE}\n"})
    return tmp_path, folders.units_of(tmp_path, folders.OURS)


def test_broken_includes(made_up):
    source, units = made_up
    found = check_units(units, source)
    for complaint in filter(None, (c for _, c in CASES.values())):
        assert sum(f.startswith(complaint) for f in found) == 1, (complaint, found)
    assert len(found) == sum(c is not None for _, c in CASES.values()), found
    assert len(check_include_lines(source)) == 3  # the includes of a forbidden folder, by lines


def test_broken_json_headers(tmp_path):
    write_tree(tmp_path, {
        "formats/base/json_text.h": "#include <nlohmann/json.hpp>\n", "formats/asset.h": "#include <nlohmann/json_fwd.hpp>\n",
        "formats/f.h": '#include "formats/g.h"\n', "formats/g.h": '#include "formats/f.h"\n',
        "runtime/s.h": '#include "runtime/t.h"\n', "runtime/t.h": '#include "formats/f.h"\n#include "formats/base/json_text.h"\n'})
    assert check_json_headers(tmp_path) == [
        "runtime/s.h reaches nlohmann/json: runtime/s.h -> runtime/t.h -> formats/base/json_text.h -> nlohmann/json.hpp",
        "runtime/t.h reaches nlohmann/json: runtime/t.h -> formats/base/json_text.h -> nlohmann/json.hpp",
        "formats/asset.h reaches nlohmann/json: formats/asset.h -> nlohmann/json_fwd.hpp"]


def test_broken_licences(made_up):
    licences = check_licences(*made_up)
    assert any(f.startswith("pipeline/a.cpp is marked Apache-2.0") for f in licences), licences
    assert any(f.startswith("runtime/r.h has no SPDX line") for f in licences), licences
    assert any(f.startswith("tests/ok.cpp is marked Apache-2.0") for f in licences), licences
    assert not any(f.startswith("formats/") for f in licences), licences


def test_forbidden_loaded_libraries():
    loaded = "\tlibc.so.6 => x\n\tlibgmp.so.10 => x\n\tlibopencv_core.so.406 => x\n\tlibboost_log.so.1 => x\n"
    assert len(check_program(loaded, "p")) == 3
