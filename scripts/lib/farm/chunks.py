# SPDX-License-Identifier: Apache-2.0
"""Divides scans into chunks of about equal work, and chunks into job arrays within the cluster's limits."""


def cut(seconds, slots, chunk_s):
    """Divides the names of `seconds` (name: estimate) in their order into chunks of about `chunk_s` of work. If there is little work, each
    slot gets a chunk."""
    total = sum(seconds.values())
    target = max(1e-9, min(chunk_s, total / slots))
    chunks, before, last = [], 0, None
    for name, cost in seconds.items():
        index = int((before + cost / 2) / target)
        if index != last:
            chunks.append([])
        chunks[-1].append(name)
        before, last = before + cost, index
    return chunks


def index_text(indices):
    """Sorted numbers in the form of Slurm's --array: 0-3,7."""
    parts, start = [], None
    for k, index in enumerate(indices):
        if start is None:
            start = index
        if k + 1 == len(indices) or indices[k + 1] != index + 1:
            parts.append(str(start) if start == index else f"{start}-{index}")
            start = None
    return ",".join(parts)


def arrays(numbers, max_array_size, room):
    """(offset, indices) for each array of the first `room` of the sorted chunks' numbers: chunk = offset + index.

    An index ends at MaxArraySize - 1; a larger one is refused as an invalid specification."""
    out = []
    for number in numbers[:max(0, room)]:
        if out and number - out[-1][0] < max_array_size:
            out[-1][1].append(number - out[-1][0])
        else:
            out.append((number, [0]))
    return out
