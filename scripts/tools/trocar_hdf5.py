#!/usr/bin/python3 -B
# SPDX-License-Identifier: Apache-2.0
"""trocar-hdf5 RECORDING -o FILE: a recording of trocar-run as HDF5 (docs/tools.md). recording_datasets.json says which columns make
which dataset. A number must be finite, unless its dataset has "finite": false."""
import itertools
import json
import pathlib

import h5py
import numpy as np
from trocar_command import VERSION, Parser, about, check_outputs, read_table, refuse_if, run, write_file

CHUNK_ROWS = 4096  # what a reader decompresses at least: about four seconds at 1 kHz


def refuse_first(wrong, what):
    refuse_if((np.any(wrong), f"line {np.argmax(wrong) + 2}: {what}"))


def add_dataset(file, table, values):
    # Adds the dataset of `values`, one row for each tick.
    kind = values.dtype
    if "words" in table:
        kind = h5py.enum_dtype({word: number for number, word in enumerate(table["words"])}, "u1")
        known = [values == word.encode() for word in table["words"]]
        refuse_first(~np.any(known, axis=0), f"{table['name']} is an unknown name")
        values = np.argmax(known, axis=0)
    elif table.get("finite", True):
        for column, numbers in zip(table["columns"], values.T):
            refuse_first(~np.isfinite(numbers), f"{column} is not finite")
    values = values[:, 0] if values.shape[1] == 1 else values
    data = file.create_dataset(table["name"], data=values, dtype=kind, chunks=(min(len(values), CHUNK_ROWS), *values.shape[1:]),
                               compression="gzip", compression_opts=6, shuffle=True)
    for key in ("columns", "units"):
        data.attrs.create(key, table[key], dtype=h5py.string_dtype())
    data.attrs.update({key: table[key] for key in ("meaning", "frame") if key in table})


def hdf5_of(text):
    # The HDF5 file in memory, and its number of ticks.
    description = json.loads(pathlib.Path(__file__).resolve().with_name("recording_datasets.json").read_text("utf-8"))
    lines = text.split("\n")
    columns, rest, lines = lines[0].split(","), lines[-1], lines[1:-1]
    tables = [table for table in description["datasets"] if table["columns"][0] in columns]
    expected = [*itertools.chain.from_iterable(table["columns"] for table in tables), "origin"]
    refuse_if((columns != expected or columns[0] != "t_s", "line 1: is not the header of a recording"),
              (rest, f"line {len(lines) + 2}: has no line feed at its end"), (not lines, "has no row"))
    types = [(table["name"], "S32" if "words" in table else table.get("type", "f8"), (len(table["columns"]),)) for table in tables]
    rows = read_table(lines, [*types, ("origin", "S1")], columns)
    refuse_first(np.diff(rows["t_s"][:, 0], prepend=-np.inf) <= 0, "t_s is not later than in the row before")
    file = h5py.File("in memory", "w", driver="core", backing_store=False)
    file.attrs.update({key: description[key] for key in ("schema", "frames")} | {"written_by": f"trocar-hdf5 {VERSION}"})
    origin = filter(None, lines[0].rpartition(",")[2].split(";"))
    file.attrs.update({f"origin.{key}": value for key, _, value in (entry.partition("=") for entry in origin)})
    for table in tables:
        add_dataset(file, table, rows[table["name"]])
    return file, len(rows)


def main(words):
    parser = Parser("trocar-hdf5", f"HDF5 {h5py.version.hdf5_version}, h5py {h5py.__version__}", "the HDF5 file to write",
                    description="Writes a recording of trocar-run as an HDF5 file. Each quantity becomes a dataset; its unit and "
                    "coordinate frame are attributes. Every number is kept bit for bit.")
    parser.add_argument("recording", metavar="RECORDING", help="the CSV file that trocar-run --record has written")
    options = parser.parse_args(words)
    check_outputs({"-o": options.output}, [options.recording])
    with about(options.recording):
        file, ticks = hdf5_of(pathlib.Path(options.recording).read_text("latin-1"))
    file.flush()
    image = file.id.get_file_image()
    write_file(options.output, image, 0o600)  # recordings name trainees
    if not options.quiet:
        print(f"{options.output}: {ticks} ticks, {len(file)} datasets, {len(image)} bytes")


if __name__ == "__main__":
    run("trocar-hdf5", main)
