# SPDX-License-Identifier: Apache-2.0
"""bench_plot.py RUN FOLDER: speed against error, FOLDER/STAGE.png for each stage that has errors; a panel for each case. A ring
marks the Pareto front: no other point is both faster and nearer. RUN is that of bench_compare.py."""
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from bench_compare import read, stages  # noqa: E402

LEAST = 1e-17  # stands for 0 on the logarithmic axis


def error_key(rows):
    """The first error that is not 0 everywhere."""
    keys = dict.fromkeys(key for row in rows for key in row.counters if key.startswith("error_"))
    return next((key for key in keys if any(row.counters.get(key) for row in rows)), None)


def pareto(points):
    return [p for p in points if not any(q[0] <= p[0] and q[1] <= p[1] and q != p for q in points)]


def draw(stage, rows, key, file):
    rows = [row for row in rows if key in row.counters]
    cases = list(dict.fromkeys(row.parts[1] for row in rows))
    columns = min(len(cases), 4)
    lines = -(-len(cases) // columns)
    figure, panels = plt.subplots(lines, columns, figsize=(4 * columns, 3.2 * lines), layout="constrained", squeeze=False)
    for panel in panels.flat[len(cases):]:
        panel.axis("off")
    for case, panel in zip(cases, panels.flat):
        of = [row for row in rows if row.parts[1] == case]
        place = {row.name: (row.time_us, max(abs(row.counters[key]), LEAST)) for row in of}
        for method in dict.fromkeys(row.parts[2] for row in of):
            mine = [row for row in of if row.parts[2] == method]
            panel.loglog(*zip(*(place[row.name] for row in mine)), "s--" if mine[0].is_peer else "o-", ms=4, lw=1, label=method)
            for row in mine:
                panel.annotate(row.parts[3], place[row.name], xytext=(3, 3), textcoords="offset points", fontsize=6)
        panel.plot(*zip(*pareto(list(place.values()))), "o", ms=9, mfc="none", mec="grey", zorder=0)
        panel.set_title(f"{stage}: {case}", loc="left", fontsize=9)
        panel.set(xlabel="time (us)", ylabel=key.removeprefix("error_").replace("_", " "))
        panel.legend(fontsize=7)
    figure.savefig(file, dpi=100, metadata={"Software": None})
    plt.close(figure)
    print(file)


def main():
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    folder = pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    for stage, rows in stages(read(sys.argv[1])).items():
        if key := error_key(rows):
            draw(stage, rows, key, folder / f"{stage}.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
