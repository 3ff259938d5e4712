# SPDX-License-Identifier: Apache-2.0
"""The numbers of a run in the text format of Prometheus, under the names that `trocar-mesh batch --metrics` uses."""
import os
import time

from errors import WRITE, FarmError


def text(numbers, store, end_s):
    """`end_s`: Unix time of the run's end."""
    label = 'store="' + store.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    classes = {"unchanged": numbers["unchanged"], "made": numbers["done"], "failed": len(numbers["failed"]),
               "known_failure": len(numbers["known_failures"]), "left": len(numbers["not_finished"])}
    gauges = (
        ("trocar_batch_scans", "Scans of the last run, each in one class.", [(f'{label},class="{name}"', count) for name, count in classes.items()]),
        ("trocar_batch_asset_bytes", "Size of the assets of those scans of the last run that are done.", [(label, numbers["asset_bytes"])]),
        ("trocar_batch_duration_seconds", "Duration of the last run.", [(label, numbers["seconds"])]),
        ("trocar_batch_end_timestamp_seconds", "Unix time at which the last run ended; time() minus this value is its age.", [(label, f"{end_s:.3f}")]))
    lines = []
    for name, help_text, samples in gauges:
        lines += [f"# HELP {name} {help_text}", f"# TYPE {name} gauge"]
        lines += [f"{name}{{{labels}}} {value}" for labels, value in samples]
    return "\n".join(lines) + "\n"


def write(file, numbers, store):
    """The file appears complete or not at all."""
    new = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        new.write_text(text(numbers, store, time.time()))
        os.replace(new, file)
    except OSError as error:
        new.unlink(missing_ok=True)
        raise FarmError(WRITE, f"{file}: {error.strerror}") from None
