# SPDX-License-Identifier: Apache-2.0
"""scripts/farm --plan: how long a collection takes, how many bytes it makes, and what saturates first, from measured constants.

The model: chunks of `chunk_s` of work on nodes * slots slots. A task also waits for its dispatch, starts the program and lets it read
the collection. Before, between and after the rounds one process checks every scan once. Resources that all slots share (the
file system, slurmctld) have a rate, and more slots than use it up do not help. The rates of the file system are measured with several
numbers of readers and writers, all on this machine; other nodes may add to them, so that the plan's limit is a lower bound."""
import json
import math
import os
import pathlib
import shutil
import tempfile

import constants
import program
from errors import DONE, WRITE, FarmError

COST_MAX, COST_WANTED = 0.05, 0.02  # shares of a chunk's time: above the first, the plan proposes a chunk with the second
CHECKS = 3  # checks of all scans: before the first, after the measuring and after the main round


def rates(of, name):
    """The measured rates of a resource, by the number of its users."""
    return {int(key.rpartition(".")[2]): value for key, value in of.items() if key.startswith(f"{name}.")}


def rate_of(measured, users):
    """The rate for a number of users: linear between measured numbers, and beyond the largest the rate of that."""
    known = sorted(measured)
    for low, high in zip(known, known[1:]):
        if low <= users <= high:
            return measured[low] + (measured[high] - measured[low]) * (users - low) / (high - low)
    return measured[known[0] if users < known[0] else known[-1]]


def limit_of(measured, each):
    """The largest number of slots that a resource serves, if each slot uses `each` of its rate in a second; at least 1."""
    largest = max(measured)
    if largest * each <= measured[largest]:
        return math.floor(measured[largest] / each)
    return max((users for users in range(1, largest + 1) if users * each <= rate_of(measured, users)), default=1)


def work_out(scans, nodes, slots_a_node, chunk_s, of, processors=0):
    """Returns the numbers of a plan. `of`: the constants' values by name. `processors`: those that all slots share if the nodes are
    processes of one machine, whose cluster has to be started first; 0: each slot has its own."""
    slots = nodes * slots_a_node
    work_s = scans * of["scan_s"]
    chunks = max(1, math.ceil(work_s / chunk_s), min(scans, slots))
    cost_s = of["dispatch_s"] + of["start_s"] + scans * of["entry_s"]  # a chunk
    task_s = work_s / chunks + cost_s
    looks_s = CHECKS * (of["start_s"] + scans * (of["entry_s"] + of["look_s"]))
    made = scans * of["made_share"]

    # How much of each shared resource a slot uses in a second, and the rate of the resource for a number of slots.
    scans_a_s = scans / chunks / task_s  # of a slot
    shared = [("slurmctld", of["controller_s"] / task_s, {1: 1}),
              ("writing atomic files", constants.FILES_PER_SCAN * scans_a_s, rates(of, "files_per_s"))]
    if rates(of, "read_bytes_per_s"):
        shared.append(("reading inputs", constants.READS_PER_SCAN * of["input_bytes"] * scans_a_s, rates(of, "read_bytes_per_s")))
    if processors:
        shared.append(("processors of this machine", 1, {1: processors}))
    limits = sorted(({"what": name, "slots": max(1, limit_of(measured, each)), "used_share": slots * each / rate_of(measured, slots)}
                     for name, each, measured in shared if each > 0), key=lambda row: row["slots"])
    useful = min([slots, *(row["slots"] for row in limits)])
    waves_s = math.ceil(chunks / useful) * task_s
    start_s = of["cluster_s"] if processors else 0
    seconds = start_s + waves_s + looks_s
    return {
        "scans": scans, "nodes": nodes, "chunk_s": chunk_s, "slots": slots, "useful_slots": useful, "chunks": chunks, "work_s": work_s, "task_s": task_s,
        "chunk_cost_s": cost_s, "chunk_cost_share": cost_s / task_s, "looks_s": looks_s, "start_s": start_s, "seconds": seconds,
        "own_cost_share": 1 - work_s / useful / seconds, "asset_bytes": made * of["asset_bytes"],
        "product_bytes": made * of["product_bytes"],
        "beside_bytes": scans * of["beside_bytes"], "files": round(made * (6 + 2 * of["product_files"]) + (scans - made)), "read_bytes": constants.READS_PER_SCAN * scans * of["input_bytes"],
        "limits": limits,
    }


def duration(seconds):
    for size, unit in ((86400, "days"), (3600, "h"), (60, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.1f} s"


def size(count):
    for unit, step in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= step:
            return f"{count / step:.3g} {unit}"
    return f"{count:.3g} bytes"


def quantity(value, unit):
    if unit.startswith("bytes"):
        return size(value) + unit.removeprefix("bytes")
    if unit == "s" and value < 0.1:
        return f"{value * 1e3:.3g} ms" if value >= 1e-4 else f"{value * 1e6:.3g} us"
    return f"{value:.3g} {unit}".strip()


def text(plan):
    first = plan["limits"][0] if plan["limits"] else None
    lines = [
        f"{plan['scans']} scans on {plan['nodes']} nodes, {plan['slots']} slots: {duration(plan['seconds'])}; {plan['chunks']} chunks",
        f"  work {duration(plan['work_s'])} on one slot; the farm's own cost {100 * plan['own_cost_share']:.1f} %: {plan['chunk_cost_s']:.2f} s a chunk, "
        f"{duration(plan['looks_s'])} for checking all scans {CHECKS} times",
        f"  written {size(plan['asset_bytes'])} of assets, {size(plan['product_bytes'])} of products and {size(plan['beside_bytes'])} of other files, "
        f"{plan['files']} files and links; read {size(plan['read_bytes'])}",
    ]
    proposed_s = 10 * math.ceil(plan["chunk_cost_s"] / COST_WANTED / 10)
    if plan["chunk_cost_share"] > COST_MAX and proposed_s > plan["chunk_s"]:
        lines.append(f"  --chunk {proposed_s} would make a chunk's cost {100 * COST_WANTED:.0f} %")
    if first:
        lines.append(f"saturates first: {first['what']}, at {first['slots']} slots"
                     + (f"; {plan['slots']} slots are no faster than {plan['useful_slots']}" if plan["useful_slots"] < plan["slots"] else ""))
    for row in plan["limits"]:
        lines.append(f"  {row['what']:36} {100 * row['used_share']:8.2f} % used, saturated at {row['slots']} slots")
    return "\n".join(lines)


def constants_text(found):
    return ["constants:", *(f"  {one.what:50} {quantity(one.value, one.unit):>12}  ({one.source})" for one in found.values())]


def main(given, root, say):
    tool = program.find(given.program, root)
    parent = pathlib.Path(os.path.abspath(given.store)).parent if given.store else None
    try:
        scratch = pathlib.Path(tempfile.mkdtemp(prefix="trocar-plan.", dir=parent))
    except OSError as error:
        raise FarmError(WRITE, f"{parent or tempfile.gettempdir()}: {error.strerror}") from None
    try:
        scans, found = constants.measure(tool, os.path.abspath(given.plan), given.store, scratch, given.local, say)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    values = {name: one.value for name, one in found.items()}
    processors = len(os.sched_getaffinity(0)) if given.local else 0
    plans = [work_out(count, given.nodes or given.local, given.slots, given.chunk, values, processors) for count in given.scans or [scans]]
    if given.json:
        print(json.dumps({"plans": plans, "constants": {name: {"what": one.what, "value": one.value, "unit": one.unit, "source": one.source}
                                                       for name, one in found.items()}}, indent=1))
    else:
        print("\n".join([*map(text, plans), *constants_text(found)]))
    return DONE
