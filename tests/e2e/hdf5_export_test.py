# SPDX-License-Identifier: Apache-2.0
"""trocar-hdf5, read back by h5py.

 1. Recordings of every force law and of a pose device: each column of the CSV file is in the dataset that GROUPS names, each
    number with the same bits; units, frames, enumerations and the origin are there.
 2. Numbers that are hard to keep (not a number, infinite, -0, subnormal, the largest), and every name of every enumeration.
 3. The same recording gives the same bytes.
 4. Files that are no recordings, damaged rows, and outputs that cannot be written: one line, the exit code, and nothing written.
"""
import csv
import os
import shutil
import subprocess

import h5py
import numpy as np
import pytest
from haply_stand_in import StandIn
from programs import run

XYZ = ("x", "y", "z")


def wrench(which):
    return [f"f{axis}_{which}_N" for axis in XYZ] + [f"t{axis}_{which}_Nm" for axis in XYZ]


# The datasets that are more than one column, or are called otherwise than their column.
GROUPS = {
    "p_m": ["x_m", "y_m", "z_m"],
    "q": ["qw", "qx", "qy", "qz"],
    "tool_m": [f"tool_{axis}_m" for axis in XYZ],
    "wrench_wanted": wrench("wanted"),
    "wrench_delivered": wrench("delivered"),
    "tau_Nm": [f"tau_{leg}_{joint}_Nm" for leg in (1, 2, 3, 4) for joint in (1, 4)],
    "motor_angle_rad": [f"th_{leg}_{joint}_rad" for leg in (1, 2, 3, 4) for joint in (1, 2, 3, 4)],
    "device_p_m": [f"device_{axis}_m" for axis in XYZ],
    "device_q": [f"device_q{axis}" for axis in "wxyz"],
    "device_wrench": wrench("device"),
    "response_offset_m": ["response_x_m", "response_y_m"],
    "wrench_tissue": wrench("tissue"),
    "stored_J": ["tissue_stored_J"],
}
UNITS = {"t_s": ["s"], "p_m": ["m"] * 3, "q": ["1"] * 4, "wrench_delivered": ["N"] * 3 + ["N m"] * 3, "tau_Nm": ["N m"] * 8,
         "motor_angle_rad": ["rad"] * 16, "response_stiffness_N_per_m": ["N/m"], "front_HU": ["HU"], "passivity_J": ["J"],
         "passivity_N_s_per_m": ["N s/m"], "device_p_m": ["m"] * 3, "state_t_s": ["s"]}
FRAMES = {"p_m": "device", "q": "device", "tool_m": "device", "wrench_delivered": "device", "wrench_tissue": "device",
          "device_p_m": "pose device", "device_wrench": "pose device", "t_s": None, "tau_Nm": None, "safety": None}
NAMES = {"state", "fault", "device_read", "device_write", "outside_fault", "safety"}
WHOLE = {"active_slice": np.int32, "break_through_at": np.int32, "cuts_published": np.int64, "response_sheet": np.int32, "recovery_asked": np.uint8, "xray": np.uint8, "steps": np.int32,
         "buttons": np.uint32}


def table(file):
    with open(file, encoding="ascii", newline="") as lines:
        rows = list(csv.reader(lines))
    return rows[0], rows[1:]


def assert_same(recording, exported):
    """Returns the number of compared values."""
    header, rows = table(recording)
    column = {name: [row[i] for row in rows] for i, name in enumerate(header)}
    compared, seen = 0, []
    with h5py.File(exported, "r") as file:
        for name, data in file.items():
            columns = GROUPS.get(name, [name])
            assert list(data.attrs["columns"]) == columns
            assert data.shape == ((len(rows),) if len(columns) == 1 else (len(rows), len(columns))), name
            assert data.compression == "gzip" and data.chunks, name
            assert data.attrs["meaning"]
            assert len(data.attrs["units"]) == len(columns)
            values = data[()].reshape(len(rows), len(columns))
            for i, each in enumerate(columns):
                seen.append(each)
                compared += len(rows)
                if name in NAMES:
                    words = {number: word for word, number in h5py.check_enum_dtype(data.dtype).items()}
                    assert [words[number] for number in values[:, i]] == column[each], name
                elif name in WHOLE:
                    assert data.dtype == WHOLE[name] and values[:, i].tolist() == list(map(int, column[each])), name
                else:
                    assert data.dtype == np.dtype("<f8"), name
                    expected = np.array(list(map(float, column[each])))
                    assert np.array_equal(np.isnan(expected), np.isnan(values[:, i])), name
                    numbers = ~np.isnan(expected)
                    assert np.array_equal(expected[numbers].view(np.uint64), np.ascontiguousarray(values[numbers, i]).view(np.uint64)), name
        for name, units in UNITS.items():
            assert name not in file or list(file[name].attrs["units"]) == units, name
        for name, frame in FRAMES.items():
            assert name not in file or file[name].attrs.get("frame") == frame, name
        assert sorted(seen) == sorted(set(header) - {"origin"}), "columns"
        assert file.attrs["schema"] == "trocar.recording-hdf5/1"
        text = column["origin"][0] if "origin" in column else ""
        origin = {key: value for key, _, value in (entry.partition("=") for entry in text.split(";") if entry)}
        assert {key[7:]: value for key, value in file.attrs.items() if key.startswith("origin.")} == origin
    return compared


def export(programs, recording, out, *options, expect=0):
    return run(programs / "trocar-hdf5", recording, "-o", out, *options, expect=expect)


@pytest.fixture(name="recordings", scope="module")
def recordings_of_all_kinds(programs, source, asset, work):
    made = {}
    for law, scene in {"hooke": "one_slice", "network": "network_middle", "cutting": "vertebra"}.items():
        made[law] = work / f"{law}.csv"
        run(programs / "trocar-run", source / "runtime/scenes" / f"{scene}.json", "--asset", asset, "--clock", "virtual", "--duration", 2,
            "--record", made[law], "--quiet")
    made["pose device"] = work / "pose.csv"
    with StandIn("--protocol", "3.1") as stand_in:  # the stand-in's times do not matter here: a fault may end the session
        done = subprocess.run([programs / "trocar-run", source / "runtime/scenes/vertebra.json", "--asset", asset, "--device",
                               f"haply:127.0.0.1:{stand_in.port}", "--late-ticks-in-row", "0", "--duration", "0.5", "--record", made["pose device"],
                               "--black-box", work, "--quiet"], check=False, capture_output=True, text=True)
        assert done.returncode in (0, 5), done.stderr
    # A recording of the console, which counts X-ray: the others have no such column.
    for kind in ("cutting", "pose device"):
        header, rows = table(made[kind])
        at, origin = header.index("motor_heat_max") + 1, header.index("origin")
        rows[0][origin] += ";xray=counted"
        made[f"{kind} with X-ray"] = work / f"xray_{kind[:4]}.csv"
        with open(made[f"{kind} with X-ray"], "w", encoding="ascii", newline="") as out:
            out.writelines(",".join(row) + "\n" for row in [header[:at] + ["xray"] + header[at:]] + [row[:at] + [str(i % 4)] + row[at:] for i, row in enumerate(rows)])
    return made


@pytest.mark.parametrize("kind", ["hooke", "network", "cutting", "pose device", "cutting with X-ray", "pose device with X-ray"])
def test_every_value(programs, recordings, work, kind):
    out = work / "out.h5"
    done = export(programs, recordings[kind], out)
    compared = assert_same(recordings[kind], out)
    header, rows = table(recordings[kind])
    assert compared == len(rows) * (len(header) - 1) and compared > 1000
    assert done.stdout.startswith(f"{out}: {len(rows)} ticks, ") and done.stderr == ""
    names = set(h5py.File(out))
    assert ("device_p_m" in names) == kind.startswith("pose device") and ("cut_J" in names) == kind.startswith(("cutting", "pose device"))
    assert ("xray" in names) == kind.endswith("with X-ray")
    again = work / "again.h5"
    assert export(programs, recordings[kind], again, "--quiet").stdout == ""
    assert again.read_bytes() == out.read_bytes()
    export(programs, recordings["hooke"], out)  # an older file is replaced
    assert_same(recordings["hooke"], out)


def test_hard_values(programs, recordings, source, work):
    header, rows = table(recordings["hooke"])
    at = {name: i for i, name in enumerate(header)}
    hard = ["nan", "inf", "-inf", "-0", "5e-324", "1.7976931348623157e+308", "-2.2250738585072014e-308", "0.1", "3.3333333333333335"]
    for i, row in enumerate(rows):
        row[at["th_2_3_rad"]], row[at["response_stiffness_N_per_m"]] = hard[i % len(hard)], hard[(i + 4) % len(hard)]
    with h5py.File(work / "out.h5", "r") as file:
        for name in NAMES:
            for i, word in enumerate(h5py.check_enum_dtype(file[name].dtype)):
                rows[i][at[name]] = word
        assert set(h5py.check_enum_dtype(file["fault"].dtype)) == set(h5py.check_enum_dtype(file["outside_fault"].dtype))
    words = (source / "formats/session/faults.cpp").read_text(encoding="utf-8")
    faults = h5py.check_enum_dtype(h5py.File(work / "out.h5")["fault"].dtype)
    assert len(faults) == 25 and all(f'"{word}"' in words for word in faults), faults
    made = work / "hard.csv"
    made.write_text("\n".join(map(",".join, [header, *rows])) + "\n")
    export(programs, made, work / "hard.h5")
    assert_same(made, work / "hard.h5")


def refused(programs, work, code, line, recording, out, *options):
    before = sorted(path.name for path in work.iterdir())
    done = export(programs, recording, out, *options, expect=code)
    assert done.stdout == "" and done.stderr == f"trocar-hdf5: {line}\n"
    assert sorted(path.name for path in work.iterdir()) == before


def test_refusals(programs, recordings, work):
    good, bad, out = recordings["hooke"], work / "bad.csv", work / "refused.h5"
    text = good.read_text()
    lines = text.split("\n")
    at = lines[0].split(",").index("penetration_m")

    def damaged(row, column, value):
        fields = lines[row].split(",")
        fields[column] = value
        bad.write_text("\n".join([*lines[:row], ",".join(fields), *lines[row + 1:]]))
        return bad

    refused(programs, work, 3, f"{bad}: line 5: penetration_m is not a number", damaged(4, at, "deep"), out)
    refused(programs, work, 3, f"{bad}: line 5: penetration_m is not finite", damaged(4, at, "inf"), out)
    refused(programs, work, 3, f"{bad}: line 9: t_s is not later than in the row before", damaged(8, 0, "0"), out)
    bad.write_text(text[:len(text) // 2])
    done = export(programs, bad, out, expect=3)
    assert done.stderr.count("\n") == 1 and "has no line feed at its end" in done.stderr and not out.exists()
    bad.write_text(lines[0] + "\n")
    refused(programs, work, 3, f"{bad}: has no row", bad, out)
    bad.write_bytes(os.urandom(5000) + b"\n")
    done = export(programs, bad, out, expect=3)
    assert done.stderr == f"trocar-hdf5: {bad}: line 1: is not the header of a recording\n" and not out.exists()
    none = work / "none.csv"
    assert export(programs, none, out, expect=3).stderr.startswith(f"trocar-hdf5: {none}: ")
    refused(programs, work, 2, f"-o {good}: would write over the input {good}", good, good)
    assert export(programs, good, work / "no" / "out.h5", expect=4).stderr.count("\n") == 1
    small = subprocess.run(["prlimit", "--fsize=20000", programs / "trocar-hdf5", good, "-o", out], check=False, capture_output=True, text=True)
    assert small.returncode == 4 and small.stderr.count("\n") == 1 and str(out) in small.stderr, small
    assert not list(work.glob("refused*")) and not list(work.glob(".refused*"))
    dashed = work / "-o.csv"
    shutil.copy(good, dashed)
    run(programs / "trocar-hdf5", "-o", "dashed.h5", "--", "-o.csv", cwd=work)
    assert_same(good, work / "dashed.h5")
