# SPDX-License-Identifier: Apache-2.0
"""What has changed between two reports."""
import re

NOISE_OF_TIMES = 0.10  # relative; smaller changes of times are not shown
NOISE_OF_HEAP = 0.005  # of bytes on the heap, which depend on the lengths of paths
NOISE_OF_REST = 1e-6
OF = " of "


def figures(value, path=()):
    """Every number by its path. Rows of lists are named by their id, entries of plain lists by index and length, so that
    only grids of the same size are compared."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from figures(part, (*path, key))
    elif isinstance(value, list):
        for k, part in enumerate(value):
            yield from figures(part, (*path, str(part.get("id", k)) if isinstance(part, dict) else f"{k}{OF}{len(value)}"))
    elif isinstance(value, (int, float)):
        yield "/".join(path), float(value)


def is_time(path):
    """True for times and what is computed from them: ratios, rates."""
    return not {"ms", "us", "s", "ratio", "Hz"}.isdisjoint(path.rsplit("/", 1)[-1].split("_"))


def only(paths):
    """The paths, each list as one entry: a grid of another size counts as one figure removed and one added."""
    return sorted({re.sub(rf"/\d+{OF}\d+.*", " (a list)", path) for path in paths})


def noise(path):
    """The smallest relative change that is shown; None for the number of samples, which is never shown."""
    words = set(path.rsplit("/", 1)[-1].split("_"))
    if "samples" in words:
        return None
    if is_time(path):
        return NOISE_OF_TIMES
    return NOISE_OF_REST if {"peak", "kept"}.isdisjoint(words) else NOISE_OF_HEAP


def moved(old, new):
    """(rows, paths only in old, paths only in new); a row: path, old, new, new / old. Largest ratio first."""
    before, after = dict(figures(old["sections"])), dict(figures(new["sections"]))
    rows = []
    for path in before.keys() & after.keys():
        a, b = before[path], after[path]
        change = abs(b - a) / max(abs(a), abs(b), 1e-300)
        least = noise(path)
        if least is not None and change > least:
            rows.append((change, path, a, b))
    rows.sort(key=lambda row: (-row[0], row[1]))
    return ([(path, a, b, b / a if a else None) for _, path, a, b in rows],
            only(before.keys() - after.keys()), only(after.keys() - before.keys()))


def show(name, old, new, page):
    rows, gone, fresh = moved(old, new)
    page.section(f"What has changed since {name}")
    if old["form"] != new["form"] or old["machine"]["processor"] != new["machine"]["processor"]:
        page.text_block(f"The two are not comparable: {name} is a {old['form']} report from {old['machine']['processor']}.", verdict=True)
    times = [row for row in rows if is_time(row[0])]
    rest = [row for row in rows if not is_time(row[0])]
    for title, part in (("Errors, counts, bytes", rest), (f"Times, by more than {100 * NOISE_OF_TIMES:.0f} %", times)):
        page.heading(f"{title}: {len(part)} changed")
        page.table(("figure", "before", "now", "ratio"), part[:40])
        if len(part) > 40:
            page.table(("figure", "before", "now", "ratio"), part[40:], folded=f"{len(part) - 40} more")
    if gone or fresh:
        page.table(("figure", "where"), [(p, "only before") for p in gone] + [(p, "only now") for p in fresh],
                   folded=f"{len(gone)} figures removed, {len(fresh)} added")
    print(f"since {name}: {len(rest)} errors, counts or bytes and {len(times)} times changed")
    shown = (rest[:20] + times[:20]) if rest and times else (rest + times)[:40]
    width = max((len(path) for path, *_ in shown), default=0)
    for path, a, b, ratio in shown:
        print(f"  {path:{width}}  {a:>12g}  {b:>12g}  {'' if ratio is None else f'x {ratio:.3g}'}")
    if len(shown) < len(rows):
        print(f"  and {len(rows) - len(shown)} more in the page")
