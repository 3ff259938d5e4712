# SPDX-License-Identifier: Apache-2.0
"""refinement_ratios.py [--rounds N] [--core K] [--only TEXT] BEFORE AFTER NAME=SCAN...: two builds of refinement_bench take turns,
pinned to one core. Prints, for each case, the medians of CPU time of triangulation and refinement, the median of the rounds'
ratios, and triangles and smallest free angle of both."""
import argparse
import json
import statistics
import subprocess


class Bench:
    def __init__(self, program, scans, core):
        self.process = subprocess.Popen(["taskset", "-c", str(core), program, *scans], text=True, stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE)

    def ask(self, request):
        self.process.stdin.write(request + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--core", type=int, default=0)
    parser.add_argument("--only", default="")
    parser.add_argument("programs", nargs=2, metavar=("BEFORE", "AFTER"))
    parser.add_argument("scans", nargs="+", metavar="NAME=SCAN")
    options = parser.parse_args()
    benches = [Bench(program, options.scans, options.core) for program in options.programs]
    cases = [case for case in benches[0].ask("list") if options.only in case]
    print(f"{'case':24}{'before ms':>16}{'after ms':>16}{'ratio':>8}{'CDT':>6}  triangles, smallest free angle")
    print(f"{'':24}{'CDT refine':>16}{'CDT refine':>16}")
    for case in cases:
        rounds = [[bench.ask("time " + case) for bench in benches] for _ in range(options.rounds)]
        cdt, refine = ([[pair[k][key] for pair in rounds] for k in (0, 1)] for key in ("cdt_ms", "refine_ms"))
        ratio = statistics.median((b[0] + r[0]) / (b[1] + r[1]) for b, r in zip(zip(*cdt), zip(*refine)))
        cdt_ratio = statistics.median(b / a for b, a in zip(*cdt))
        times = [f"{statistics.median(cdt[k]):7.1f}{statistics.median(refine[k]):8.1f}" for k in (0, 1)]
        before, after = (bench.ask("check " + case) for bench in benches)
        same = "same bytes" if before["digest"] == after["digest"] else "; ".join(
            f"{key} {before[key]} -> {after[key]}" for key in ("below", "below_at_small_input_angle", "unrefined", "not_delaunay",
                                                               "max_area_mm2") if before[key] != after[key])
        print(f"{case:24}{times[0]:>16}{times[1]:>16}{ratio:8.3f}{cdt_ratio:6.2f}  {before['triangles']} -> "
              f"{after['triangles']} ({after['triangles'] / before['triangles']:.4f}), {before['free_angle_deg']:.3f} -> "
              f"{after['free_angle_deg']:.3f}; {same}", flush=True)


if __name__ == "__main__":
    main()
