# SPDX-License-Identifier: Apache-2.0
"""Which folder may include which, which libraries, and under which licence it stands. (That each library's code is complete in the
libraries that it links is the linker's business.)"""
import re
import subprocess

import pytest
from programs import PROGRAMS, SOURCE

# From the lowest layer up: a folder includes only itself and folders before it.
ORDER = """formats/base formats/mesh formats/asset formats/session formats/examples
    pipeline/read pipeline/read/dicom pipeline/open pipeline/segment pipeline/contour pipeline/surface pipeline/bake pipeline/preview
    pipeline/batch pipeline/program
    runtime/realtime runtime/device runtime/device/four_legs runtime/device/link runtime/device/pose runtime/device/simulated
    runtime/haptics runtime/haptics/membrane runtime/haptics/bone runtime/haptics/loop runtime/session runtime/check runtime/report
    runtime/console runtime/program""".split()
# The loop, its force laws and the checks work with any hand device.
ANY_DEVICE = re.compile(r"runtime/(haptics|check)/|runtime/session/(pose_session|live_hand|session|session_clock)\.")
ONE_DEVICE = re.compile(r"runtime/device/(four_legs|link|simulated)/(?!hand\.h)")  # the hand moves the tool of any simulated device
HEAVY = re.compile(r"opencv|CGAL/|gmp|mpfr")
ONLY = {"boost/": re.compile(r"runtime/(console|device/pose)/"), "tiny_gltf.h": re.compile("formats/asset/"), "draco/": re.compile("formats/asset/")}
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^">]+)[">]', re.MULTILINE)


def broken_includes(name, included):
    """What is wrong with the includes of the file `name`, a path from the top folder."""
    folder, out = name.rpartition("/")[0], []
    if folder not in ORDER:
        return [f"{name}: its folder is missing in ORDER"]
    for other in included:
        theirs = other.rpartition("/")[0]
        if other.split("/")[0] in ("sample_ct", "tests") or {name.split("/")[0], other.split("/")[0]} == {"pipeline", "runtime"}:
            out.append(f"{name} includes {other}")
        elif theirs in ORDER and ORDER.index(theirs) > ORDER.index(folder):
            out.append(f"{name} includes {other}, which is above it")
        elif ANY_DEVICE.match(name) and ONE_DEVICE.match(other):
            out.append(f"{name} works with any device, and includes {other}")
        elif not name.startswith("pipeline/") and HEAVY.search(other):
            out.append(f"{name} includes {other}")
        out += [f"{name} includes {other}" for library, where in ONLY.items() if other.startswith(library) and not where.match(name)]
    return out


def sources(*folders):
    listed = subprocess.run(["git", "-C", SOURCE, "ls-files", *folders], capture_output=True, text=True, check=False)
    if listed.returncode != 0:
        pytest.skip("no git checkout")
    return [SOURCE / name for name in listed.stdout.split("\n") if name and (SOURCE / name).is_file()]


def test_includes():
    broken = []
    for path in sources("formats", "pipeline", "runtime"):
        if path.suffix in (".h", ".cpp"):
            broken += broken_includes(str(path.relative_to(SOURCE)), INCLUDE.findall(path.read_text()))
    assert not broken, "\n".join(broken)


@pytest.mark.parametrize("name, other", [
    ("formats/mesh/cut.h", "formats/asset/asset.h"), ("runtime/haptics/tool.h", "pipeline/open/open_stack.h"),
    ("formats/base/result.h", "opencv2/core.hpp"), ("runtime/haptics/tool.h", "runtime/device/four_legs/four_legs.h"),
    ("runtime/session/session.cpp", "runtime/device/link/udp_link.h"), ("pipeline/open/open_stack.h", "tests/support/random.h"),
    ("runtime/session/origin.cpp", "boost/asio.hpp"), ("pipeline/bake/report.cpp", "draco/mesh/mesh.h"), ("runtime/new/a.h", "a.h")])
def test_a_wrong_include_is_found(name, other):
    assert broken_includes(name, [other])


def test_licences():
    wrong = []
    for path in sources():
        name = str(path.relative_to(SOURCE))
        text = path.read_text(errors="replace") if path.suffix in (".h", ".cpp", ".py", ".mjs", ".js", ".cmake") or path.name == "CMakeLists.txt" else ""
        if not text or name.startswith("formats/examples/CMake"):
            continue
        found = re.search(r"SPDX-License-Identifier: (\S+)", text[:300])
        theirs = found[1] if found else None
        includes = INCLUDE.findall(text) if path.suffix in (".h", ".cpp") else []
        gpl = name.startswith("pipeline/") or (name.startswith("tests/") and any(i.startswith(("pipeline/", "CGAL/")) for i in includes))
        if theirs != ("GPL-3.0-or-later" if gpl else "Apache-2.0") and not (name.startswith("tests/") and theirs == "GPL-3.0-or-later"):
            wrong.append(f"{name}: {theirs}")
    assert not wrong, "\n".join(wrong)


def test_the_runtime_loads_no_heavy_library():
    loaded = subprocess.run(["ldd", PROGRAMS / "trocar-run"], capture_output=True, text=True, check=True).stdout
    assert not re.findall(r"lib(?:opencv_\w+|gmp|gmpxx|mpfr|boost_\w+|CGAL\w*)\.so", loaded)
