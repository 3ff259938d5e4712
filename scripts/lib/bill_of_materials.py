# SPDX-License-Identifier: Apache-2.0
"""bill_of_materials.py BUILD OUT.cdx.json: what the built programs consist of, as CycloneDX 1.4 JSON.

Read from the build itself: Debian packages of the shared libraries that each program loads
(ldd) and of the headers that its objects were compiled from (`ninja -t deps`), each with its
version and package URL. The headers are read so that header-only libraries and the compiler's own are listed.
The same build gives the same file, apart from `timestamp`, which is SOURCE_DATE_EPOCH's if set.
"""
import datetime
import json
import os
import pathlib
import re
import subprocess
import sys
import uuid

PROGRAMS = {  # program: (package, licence)
    "trocar-mesh": ("trocar-mesh", "GPL-3.0-or-later"),
    "trocar-sample-ct": ("trocar-sample-ct", "Apache-2.0"),
    "trocar-run": ("trocar-runtime", "Apache-2.0"),
    "trocar-device-sim": ("trocar-runtime", "Apache-2.0"),
    "trocar-console": ("trocar-console", "Apache-2.0"),
}


def output_of(*command):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def shared_libraries(program):
    """Files that the dynamic linker loads for it."""
    return {line.split("=>")[1].split()[0] for line in output_of("ldd", str(program)).splitlines()
            if "=> /" in line}


def inputs_of(build, target):
    """Object files and archives' objects that `target` is linked from, relative to the build folder."""
    commands = output_of("ninja", "-C", str(build), "-t", "commands", target)
    return set(re.findall(r" -o (\S+\.o) -c ", commands))


def headers_by_object(build):
    found, current = {}, None
    for line in output_of("ninja", "-C", str(build), "-t", "deps").splitlines():
        if line.startswith("    "):
            found[current].append(line.strip())
        elif ": #deps" in line:
            current = line.split(": #deps")[0]
            found[current] = []
    return found


def packages_of(files):
    """{Debian package: version} that the files belong to."""
    files = sorted({os.path.realpath(f) for f in files} | {re.sub("^/usr/lib/", "/lib/", f) for f in files}
                   | {re.sub("^/lib/", "/usr/lib/", os.path.realpath(f)) for f in files})
    names = set()
    for start in range(0, len(files), 500):
        found = subprocess.run(["dpkg-query", "-S", *files[start:start + 500]], check=False,
                               stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
        for line in found.splitlines():
            if not line.startswith("diversion"):
                names |= {name.split(":")[0] for name in line.split(": ")[0].split(", ")}
    if not names:
        return {}
    listing = output_of("dpkg-query", "-W", "-f", "${Package} ${Version} ${Architecture}\n", *sorted(names))
    return {name: (version, architecture) for name, version, architecture in map(str.split, listing.splitlines())}


def main():
    if len(sys.argv) != 3:
        print("usage: bill_of_materials.py BUILD OUT.cdx.json", file=sys.stderr)
        return 2
    build, out = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    version = re.search(r"^CMAKE_PROJECT_VERSION:\w+=(.*)$", (build / "CMakeCache.txt").read_text(), re.M)[1]
    headers = headers_by_object(build)
    components, dependencies = {}, []
    for program, (package, licence) in PROGRAMS.items():
        files = {f for o in inputs_of(build, program) for f in headers.get(o, []) if f.startswith("/usr/")}
        needed = packages_of(files | shared_libraries(build / "bin" / program))
        if not needed:
            print(f"bill_of_materials: nothing is known of what {program} was built from", file=sys.stderr)
            return 1
        reference = f"{package}/{program}@{version}"
        components[reference] = {"type": "application", "bom-ref": reference, "name": program, "version": version,
                                 "licenses": [{"license": {"id": licence}}]}
        for name, (its_version, architecture) in needed.items():
            purl = f"pkg:deb/debian/{name}@{its_version.replace(':', '%3A').replace('+', '%2B')}?arch={architecture}"
            components[purl] = {"type": "library", "bom-ref": purl, "name": name, "version": its_version, "purl": purl}
        dependencies.append({"ref": reference, "dependsOn": sorted(
            ref for ref, c in components.items() if c["type"] == "library" and c["name"] in needed)})
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    time = datetime.datetime.fromtimestamp(int(epoch), datetime.timezone.utc) if epoch else \
        datetime.datetime.now(datetime.timezone.utc)
    body = {"components": [components[k] for k in sorted(components)], "dependencies": dependencies}
    serial = uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(body, sort_keys=True))
    bill = {"bomFormat": "CycloneDX", "specVersion": "1.4", "serialNumber": f"urn:uuid:{serial}", "version": 1,
            "metadata": {"timestamp": time.strftime("%Y-%m-%dT%H:%M:%SZ"),
                         "component": {"type": "application", "bom-ref": f"trocar@{version}", "name": "trocar",
                                       "version": version}}, **body}
    out.write_text(json.dumps(bill, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
