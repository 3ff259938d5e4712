# SPDX-License-Identifier: Apache-2.0
"""The installed tree, used without the source tree.

Installs all components, then: every program answers --version with the project's
version; the console and the scenes work on the installed examples; every schema is installed; every
installed header compiles by itself; the man pages render and name
every option of --help; the example program builds against find_package(Trocar) and lists the
slices that `trocar-mesh info` lists; the bill of materials names the libraries that are used.
"""
import json
import os
import re
import shutil
import subprocess
import sys

import pytest
from console_client import Console
from programs import ASSETS, BUILD, run

PROGRAMS = ("trocar-mesh", "trocar-sample-ct", "trocar-run", "trocar-device-sim", "trocar-console", "trocar-fit", "trocar-hdf5")


@pytest.fixture(name="usr", scope="module")
def installed_tree(work):
    run("cmake", "--install", BUILD, "--prefix", work / "usr")
    return work / "usr"


@pytest.fixture(name="version", scope="module")
def project_version():
    return re.search(r"^CMAKE_PROJECT_VERSION:\w+=(.*)$", (BUILD / "CMakeCache.txt").read_text(), re.M)[1]


@pytest.fixture(name="asset", scope="module")
def sample_asset():
    return ASSETS / "sample.glb"


def test_programs(usr, version):
    for name in PROGRAMS:
        said = run(usr / "bin" / name, "--version").stdout.split()
        assert said[:2] == [name, version], f"{name} --version: {said}, expected {version}"


def test_schemas(usr, source):
    installed = sorted(path.name for path in (usr / "share/trocar/schemas").iterdir())
    assert installed == sorted(path.name for path in (source / "formats/session").glob("*.schema.json")), f"installed schemas: {installed}"


def test_console(usr, work):
    """The installed console serves its page, and starts the installed trocar-run on the installed examples, which stay as they are."""
    examples, state = usr / "share/trocar/examples", work / "state"
    before = sorted(examples.rglob("*"))
    console = Console(usr / "bin/trocar-console", examples, env={**os.environ, "XDG_STATE_HOME": str(state)})
    status, page = console.get("/", token=None)
    assert status == 200 and b"<html" in page, f"the console's page: {status}"
    has_vendor = (usr / "share/trocar/console/vendor").is_dir()
    assert not has_vendor or console.get("/vendor/three.module.js", token=None)[0] == 200, "three.js of the installed page"
    assert (b"scripts/setup console" in page) != has_vendor, "the page does not say what is missing"
    live = console.live()
    assert console.post("/api/start", {"scene": "scenes/vertebra.json", "clock": "virtual"})[0] == 200, "a session"
    assert live.until(lambda l: l.state() == "ended", 60) and "puncture" in live.kinds(), f"{live.states} {live.kinds()}"
    names = [recording["file"] for recording in console.get("/api/folder")[1]["recordings"]]
    assert len(names) == 1 and (state / "trocar" / names[0]).exists(), f"recordings: {names}"
    assert console.get(f"/api/recording?file={names[0]}")[0] == 200, "the session's recording"
    assert console.stop() == 0, "the console's exit code"
    assert sorted(examples.rglob("*")) == before, "the console wrote into the installed examples"


def test_examples(usr):
    """Every installed scene finds its asset and passes its check."""
    scenes = sorted((usr / "share/trocar/examples/scenes").glob("*.json"))
    assert len(scenes) >= 5, f"installed scenes: {scenes}"
    for scene in scenes:
        run(usr / "bin/trocar-run", "check", scene, "--device-description", usr / "share/trocar/device/four_legs.json", "--strict")


def test_farm(usr):
    """The examples for a cluster can be run where they are."""
    examples = usr / "share/doc/trocar-mesh/examples"
    assert run(examples / "slurm/array.sh", expect=2).stderr.startswith("usage: array.sh"), "array.sh"
    assert (examples / "snakemake/Snakefile").is_file() and (examples / "snakemake/slurm/config.yaml").is_file(), "the Snakefile and its profile"


def test_man_pages(usr):
    if not shutil.which("man") or not shutil.which("help2man"):
        print("no man or help2man here: man pages not checked")
        return
    for name in PROGRAMS:
        page = run("man", "--warnings", "-l", usr / "share/man/man1" / f"{name}.1.gz",
                   env={"MANWIDTH": "100", "LC_ALL": "C.UTF-8", "PATH": "/usr/bin:/bin"})
        assert not page.stderr, f"man {name}: {page.stderr}"
        options = set(re.findall(r"--[a-z][a-z-]+", run(usr / "bin" / name, "--help").stdout))
        text = page.stdout.replace("\u2010\n", "-").replace("\u2010", "-")
        missing = [o for o in sorted(options) if o not in text]
        assert options and not missing, f"man {name} lacks {missing}"


def test_example(usr, asset, work):
    example = work / "example"
    run("cmake", "-S", usr / "share/doc/trocar-formats-dev/examples", "-B", example,
        f"-DCMAKE_PREFIX_PATH={usr}", "-DCMAKE_BUILD_TYPE=Release")
    run("cmake", "--build", example)
    listed = re.findall(r"^slice (\d+): z (\S+) mm, (\d+) vertices, (\d+) triangles$",
                        run(example / "list_slices", asset).stdout, re.M)
    info = json.loads(run(usr / "bin/trocar-mesh", "info", asset, "--json").stdout)
    expected = [(s["index"], s["z_mm"], s["vertices"], s["triangles"]) for s in info["slices"]]
    found = [(int(i), float(z), int(v), int(t)) for i, z, v, t in listed]
    assert (len(found) > 1 and [f[0::2] + f[3:] for f in found] == [e[0::2] + e[3:] for e in expected]
          and all(abs(f[1] - e[1]) < 1e-3 for f, e in zip(found, expected))), f"the example lists {found[:3]} ..., info {expected[:3]} ..."
    run(example / "list_slices", __file__, expect=3)
    unknown = work / "unknown"
    unknown.mkdir()
    (unknown / "CMakeLists.txt").write_text("cmake_minimum_required(VERSION 3.25)\nproject(x LANGUAGES CXX)\n"
                                            "find_package(Trocar REQUIRED COMPONENTS nothing)\n")
    failed = subprocess.run(["cmake", "-S", unknown, "-B", unknown / "b", f"-DCMAKE_PREFIX_PATH={usr}"],
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
    assert failed.returncode != 0, "find_package(Trocar COMPONENTS nothing) is accepted"


def test_headers(usr, work):
    """Every installed header compiles by itself, with the dependencies of the package alone."""
    folder = work / "headers"
    folder.mkdir()
    headers = sorted(p.relative_to(usr / "include/trocar") for p in (usr / "include/trocar").rglob("*.h"))
    assert len(headers) > 10, f"installed headers: {headers}"
    unit = folder / "unit.cpp"
    for header in headers:
        unit.write_text(f'#include "{header}"\n#include "{header}"\nint main() {{ return 0; }}\n')
        done = subprocess.run(["c++", "-std=c++20", "-fsyntax-only", f"-I{usr / 'include/trocar'}", "-isystem",
                               "/usr/include/eigen3", unit], stderr=subprocess.PIPE, text=True, check=False)
        assert done.returncode == 0, f"{header} does not compile by itself: {done.stderr[:500]}"


def test_versions(source, version):
    """One version everywhere."""
    assert f"\nversion: {version}\n" in (source / "CITATION.cff").read_text(), f"CITATION.cff is not of {version}"
    assert f"## [{version}]" in (source / "CHANGELOG.md").read_text(), f"CHANGELOG.md has no section {version}"


def test_bill_of_materials(source, work):
    bill = work / "trocar.cdx.json"
    run(sys.executable, "-B", source / "scripts/lib/bill_of_materials.py", BUILD, bill)
    bill = json.loads(bill.read_text())
    assert bill["bomFormat"] == "CycloneDX" and bill["specVersion"] == "1.4", "the bill's format"
    references = [c["bom-ref"] for c in bill["components"]]
    assert len(references) == len(set(references)), "a component stands twice in the bill"
    used = {d["ref"].split("/")[1].split("@")[0]: {r.split("/")[2].split("@")[0] for r in d["dependsOn"]}
            for d in bill["dependencies"]}
    # The numbers in their names differ between releases of Debian.
    for name, needed in (("trocar-mesh", ("libdraco", "libtinygltf-dev", "libeigen3-dev", "libdcmtk", "libopencv-core")),
                         ("trocar-run", ("libdraco", "libeigen3-dev", "libsodium", "libc6"))):
        for library in needed:
            assert any(re.fullmatch(rf"{library}[0-9]*(t64)?", n) for n in used.get(name, ())), f"the bill of {name} lacks {library}: {used.get(name)}"
    assert not any(re.match("libopencv|libcgal", n) for n in used["trocar-run"]), "OpenCV or CGAL in trocar-run's bill"
