# SPDX-License-Identifier: Apache-2.0
"""Describes what a report was measured on: machine, system, versions."""
import os
import pathlib
import platform
import re
import subprocess

PACKAGES = ("libopencv-core-dev", "libcgal-dev", "libdraco-dev", "libtbb-dev", "libdcmtk-dev", "libeigen3-dev")


def output(*command):
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def describe():
    info = pathlib.Path("/proc/cpuinfo").read_text()
    model = re.search(r"^model name\s*:\s*(.*)$", info, re.MULTILINE)
    memory = re.search(r"^MemTotal:\s*(\d+) kB", pathlib.Path("/proc/meminfo").read_text(), re.MULTILINE)
    return {
        "processor": model.group(1) if model else platform.machine(),
        "cores_count": len(os.sched_getaffinity(0)),
        "memory_bytes": int(memory.group(1)) * 1024,
        "kernel": platform.release(),
        "load_average_at_start": os.getloadavg()[0],
    }


def versions(root, programs):
    cache = (programs.parent / "CMakeCache.txt").read_text()

    def cached(name):
        found = re.search(rf"^{name}:\w+=(.*)$", cache, re.MULTILINE)
        return found.group(1) if found else ""

    found = {
        "trocar": output("git", "-C", str(root), "describe", "--always", "--dirty"),
        "system": next((line.split("=", 1)[1].strip('"') for line in pathlib.Path("/etc/os-release").read_text().splitlines()
                        if line.startswith("PRETTY_NAME=")), ""),
        "compiler": output(cached("CMAKE_CXX_COMPILER"), "--version").partition("\n")[0],
        "build_type": cached("CMAKE_BUILD_TYPE"),
        "python": platform.python_version(),
    }
    for package in PACKAGES:
        found[package] = output("dpkg-query", "-W", "-f", "${Version}", package)
    return found


def busy(report):
    """The load average if it exceeds the number of cores, else None."""
    machine = report["machine"]
    load = max(machine["load_average_at_start"], machine.get("load_average_at_end", 0))
    return load if load > machine["cores_count"] else None


def sentence(report):
    machine = report["machine"]
    meanwhile = ", busy with other work at the time" if busy(report) else ""
    return (f"{report['form']} report of {report['made'][:10]}, trocar {report['versions']['trocar']}, {machine['processor']}, "
            f"{machine['cores_count']} cores{meanwhile}, {report['versions']['compiler']}")


def show(report, page):
    machine = report["machine"]
    page.text_block(f"A {report['form']} report, {report['made']}, on {machine['processor']} ({machine['cores_count']} cores, "
                    f"{machine['memory_bytes'] / 2**30:.1f} GiB), {report['versions']['system']}. Times are medians in one process, "
                    "one thread unless said otherwise. All figures with their names: report.json.")
    if load := busy(report):
        page.text_block(f"The machine was busy with other work (load average {load:.1f} on {machine['cores_count']} "
                        "cores): wall-clock times are too long; errors, counts and bytes are not affected.", verdict=True)
    page.table(("what", "version"), list(report["versions"].items()), folded="versions")
