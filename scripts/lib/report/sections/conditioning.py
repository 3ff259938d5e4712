# SPDX-License-Identifier: Apache-2.0
"""Conditioning: rounding errors of the predicates, the network's equilibrium, the Jacobian and the torques.

Measured by the program conditioning_sweep, against integers of any length or 50 digits. Nothing here
depends on the machine's speed."""
import json
import subprocess

import conditioning_plots as plots

TITLE = "Conditioning: rounding, on random and hard inputs"
ORDER = 70


def measure(context):
    many = 5 if context.full else 1
    plan = {"predicate_inputs": 20000 * many, "network_side": 16 if context.full else 12, "poses": 200 * many, "allocations": 200 * many}
    done = subprocess.run([context.programs / "conditioning_sweep"], input=json.dumps(plan), text=True,
                          stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def worst(rows, *keys):
    return max(row[key] for row in rows for key in keys if key in row)


def figures(data):
    """For each part: (name, rows, error on ordinary inputs, largest error on all inputs)."""
    network, jacobian, allocation = data["network"], data["jacobian"], data["allocation"]
    displacement = ("displacement_error_local", "displacement_error_global")
    stiffness = ("stiffness_error_local", "stiffness_error_global")
    compact = ("error_compact", "error_influence")
    return [
        ("network, displacements", network, worst(network[:1], *displacement), worst(network, *displacement)),
        ("network, stiffness", network, worst(network[:1], *stiffness), worst(network, *stiffness)),
        ("Jacobian", jacobian, worst(jacobian[:1], *compact), worst(jacobian, *compact)),
        ("torques", allocation, worst(allocation[:1], "torque_error"), worst(allocation, "torque_error")),
    ]


def show(data, page):
    wrong = sum(row["wrong_signs"] for row in data["predicates"])
    count = sum(row["count"] for row in data["predicates"])
    doubles = sum(row["wrong_signs_of_doubles"] for row in data["predicates"])
    ordinary = "; ".join(f"{name} {error:.1e}" for name, _, error, _ in figures(data))
    page.text_block(f"Predicates: {wrong} wrong signs of {count} ({doubles} by the same formulas in doubles). Largest relative error "
                    f"on ordinary inputs: {ordinary}.", verdict=True)
    page.plot(plots.errors(data), "Largest relative error over each kind of input (dots), and the bound stated for it (bars; for torques in the table). "
              "Unit roundoff is dotted.")
    page.heading("Predicates on the lattice")
    page.table(("predicate and inputs", "count", "of these zero", "wrong sign", "wrong sign in doubles"),
               [(row["id"], row["count"], row["of_these_zero"], row["wrong_signs"], row["wrong_signs_of_doubles"]) for row in data["predicates"]])
    page.heading("The network's equilibrium")
    page.text_block("Against elimination in 50 digits of the network that the lattice's integers define. Displacements are relative to the tool's "
                    "depth; bound: 4 units of rounding times Skeel's condition number of the equilibrium. The stiffness is a sum of springs' "
                    "forces, and where a free sheet is held only by a very soft bed, the sum is smaller than its terms by "
                    "the factor in the column cancellation.")
    page.table(("inputs", "free nodes", "condition", "cancellation", "springs and beds", "displacement, local", "global", "bound", "stiffness, local", "global", "bound"),
               [(row["id"], row["count"], row["condition"], row["cancellation"], row["coefficient_error"], row["displacement_error_local"],
                 row["displacement_error_global"], row["bound"], row["stiffness_error_local"], row["stiffness_error_global"], row["stiffness_bound"])
                for row in data["network"]])
    page.heading("The Jacobian")
    page.text_block("Each row relative to its largest entry, against differences in 50 digits of the closed-form inverse kinematics. Near the end "
                    "of a branch, where a leg is stretched or folded, the angle's derivative is unbounded, and errors grow with the inverse of the "
                    "distance; at the end itself the pose is refused as singular.")
    page.table(("poses", "count", "refused as singular", "least distance to a branch's end, m", "compact form", "influence coefficients", "bound"),
               [(row["id"], row["count"], row["refused_as_singular"], row.get("nearest_branch_m"), row.get("error_compact"),
                 row.get("error_influence"), row.get("bound")) for row in data["jacobian"]])
    page.heading("Torque allocation")
    page.text_block("Against the optimum that torque_allocation.h states, enumerated in 50 digits. Bound: 64 units of rounding over the inverse condition number of the "
                    "Jacobian, times the slope of the torques (torque_allocation.h) or, for scale and wrench, the spread of the limits.")
    page.table(("inputs", "count", "minimum norm", "null space", "scaled", "least inverse condition", "torques", "scale", "wrench", "largest part of its bound"),
               [(row["id"], row["count"], row["minimum_norm"], row["null_space"], row["scaled"], row["inverse_condition_least"], row["torque_error"],
                 row["scale_error"], row["wrench_error"], row["largest_part_of_bound"]) for row in data["allocation"]])


def results(data):
    wrong, count = (sum(row[key] for row in data["predicates"]) for key in ("wrong_signs", "count"))
    errors = ", ".join(f"{name} {ordinary:.0e} ({hard:.0e})" for name, _, ordinary, hard in figures(data))
    return [f"Rounding, against 50 digits: {wrong} wrong signs of {count} predicates; largest relative error on ordinary inputs (and on those "
            f"made to be hard): {errors}."]
