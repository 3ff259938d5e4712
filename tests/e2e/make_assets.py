# SPDX-License-Identifier: Apache-2.0
"""make_assets.py BIN SCAN OUT: the scans' assets with trocar-mesh's defaults, for tests that need
real slices: OUT/sample.glb from the folder SCAN (trocar-sample-ct's), OUT/l3.glb and OUT/head.glb if TROCAR_REAL_CT and
TROCAR_HEAD_CT give their scans; each also as NAME_dp.glb, by Douglas-Peucker at 0.25 mm."""
import os
import pathlib
import sys

from programs import run


def main():
    programs, scan, out = map(pathlib.Path, sys.argv[1:])
    out.mkdir(parents=True, exist_ok=True)
    scans = {
        "sample": scan / "sample.nii.gz",
        "l3": pathlib.Path(os.environ.get("TROCAR_REAL_CT", "")) / "l3" / "sub-ct_label-22_ct.nii.gz",
        "head": pathlib.Path(os.environ.get("TROCAR_HEAD_CT", "") or "/nowhere"),
    }
    for name, source in scans.items():
        for suffix, options in (("", ()), ("_dp", ("--simplify", "dp", "--tolerance", "0.25"))):
            asset = out / f"{name}{suffix}.glb"
            if source.is_file():
                run(programs / "trocar-mesh", source, "-o", asset, "--quiet", *options)
                print(f"{asset}: {asset.stat().st_size} bytes")
            elif asset.exists():
                asset.unlink()  # its scan is no longer available


if __name__ == "__main__":
    main()
