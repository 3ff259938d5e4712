#!/usr/bin/python3 -B
# SPDX-License-Identifier: Apache-2.0
"""trocar-fit CURVE -o TISSUE.json: fits the force law `cutting` to a measured curve of force over depth (docs/trocar-fit.md)."""
# A nonlinear least squares problem, solved by Levenberg-Marquardt from several starts. The residuals are correlated over about a
# millimetre, because bone is not uniform; taken as independent they would make the intervals several times too narrow. A 90 %
# interval is 1.645 standard deviations to either side. Lengths are in mm, forces in N.
import io
import itertools
import json
import pathlib
from types import SimpleNamespace

import numpy as np
import scipy
from scipy.optimize import least_squares
from trocar_command import USAGE, Failure, Parser, about, check_outputs, read_table, refuse_if, run, write_file

LEAST_ROWS, MOST_ROWS, MOST_BYTES = 20, 200_000, 16 << 20
MOST = {"depth_mm": 1e6, "force_N": 1e5, "speed_mm_per_s": 1e6, "time_s": 1e9}  # the columns, and the limits of their values
# Outer diameters of needles (ISO 9626).
GAUGES_MM = {8: 4.191, 9: 3.759, 10: 3.404, 11: 3.048, 13: 2.413, 14: 2.108, 15: 1.829, 16: 1.651, 17: 1.473, 18: 1.27, 22: 0.718, 25: 0.515}
# What a scene's tissue allows.
RANGES = {"stiffness_N_per_m": (1, 1e7), "threshold_N": (0.01, 1000), "strength_MPa": (0, 1000), "modulus_MPa": (0, 1e5), "friction_kPa": (0, 1e5)}
QUANTILE_95, POISSON = 1.6448536269514722, 0.3  # quantile of the normal distribution; Poisson's ratio of the tissue

# The parameters. BASELINE: the load cell's force before contact. CONTACT: depth of the surface. LOG_STIFFNESS: of the tip, N/mm.
# CUTTING: strength at the cut depth MIDDLE. FRICTION: per embedded length, N/mm. DRIFT: change of the strength with depth, N/mm.
# LAYER: strength of a hard layer at the surface. LAYER_END: depth of the middle of the stretch of length FALL in which the layer's
# force falls. MIDDLE and FALL are never fitted; FALL is 0 if there is no layer.
BASELINE, CONTACT, LOG_STIFFNESS, CUTTING, FRICTION, DRIFT, LAYER, LAYER_END, MIDDLE, FALL = range(10)
LEAST_OF, MOST_OF = np.full(10, -np.inf), np.full(10, np.inf)  # where the model is defined
LEAST_OF[[LOG_STIFFNESS, CUTTING, LAYER]], MOST_OF[LOG_STIFFNESS] = (np.log(1e-6), 1e-6, 1e-6), np.log(1e7)


def parse_curve(text):
    # {column: values} of a CSV file.
    first, *lines = text.rstrip().splitlines() or [""]
    separator = next((s for s in "\t;" if s in first), ",")
    names = [name.strip() for name in first.split(separator, len(MOST) + 1)]
    refuse_if((not {"depth_mm", "force_N"} <= set(names) <= set(MOST), "line 1: the first line must name the columns depth_mm and force_N, "
               "and may name speed_mm_per_s and time_s"), (len(set(names)) < len(names), "line 1: a column occurs twice"),
              (not lines, "has no row of numbers"), (len(lines) > MOST_ROWS, f"has more than {MOST_ROWS} rows"))
    rows = read_table(lines, [("all", float, (len(names),))], names, separator)["all"]
    for row, column in np.argwhere(~(np.abs(rows) <= [MOST[name] for name in names])):
        refuse_if((True, f"line {row + 2}: {names[column]} is not finite, or beyond {MOST[names[column]]:g}"))
    return dict(zip(names, rows.T))


def branches_of(columns):
    # Insertion, up to the deepest point, and withdrawal, which may be missing: rows of depth and force.
    points = np.stack([columns["depth_mm"], columns["force_N"]], axis=1)
    deepest = points[:, 0].argmax()
    insertion, withdrawal = points[:deepest + 1], points[deepest + 1:]
    travel = np.ptp(insertion[:, 0])
    refuse_if((not 1 <= travel <= 500, f"depth_mm grows by {travel:.4g} while the tool moves in, and must grow by 1 to 500 mm"),
              (len(insertion) < LEAST_ROWS, f"has {len(insertion)} rows up to the deepest point, and must have at least {LEAST_ROWS}"),
              (np.ptp(insertion[:, 1]) == 0, f"force_N is {insertion[0, 1]:g} in all rows"))
    if points[deepest, 0] - withdrawal[:, 0].min(initial=np.inf) < 0.1 * travel:
        withdrawal = withdrawal[:0]  # the machine came to rest
    for way in (insertion[:, 0], -withdrawal[:, 0]):  # encoders are noisy
        refuse_if((np.any(np.maximum.accumulate(way) - way > max(0.02 * travel, 0.02)),
                   "depth_mm goes back and forth; a curve has one insertion and at most one withdrawal"))
    return insertion, withdrawal


def means_of(points, most, noise):
    # Rows of mean depth, mean force and number of points, in at most `most` stretches of depth.
    # The stretches have equal length, but are halved where the force changes by more than `noise` explains.
    points = points[np.argsort(points[:, 0], kind="stable")]
    depth, equal = points[:, 0], most * 3 // 5
    index = np.minimum((depth - depth[0]) * equal / max(np.ptp(depth), 1e-300), equal - 1).astype(int)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(index)) + 1, [len(points)]])
    for round_left in range(8, -1, -1):
        begin, end = edges[:-1], edges[1:]
        means = np.column_stack([np.add.reduceat(points, begin) / (end - begin)[:, None], end - begin])
        before, after = means[[0, *range(len(means) - 1)]], means[[*range(1, len(means)), -1]]
        limit = np.maximum(0.04 * np.ptp(means[:, 1]), 4 * noise * np.sqrt(1 / before[:, 2] + 1 / after[:, 2]))
        splits = (np.abs(after[:, 1] - before[:, 1]) > 2 * limit) & (depth[begin] < depth[end - 1])
        splits &= np.cumsum(splits) <= most - len(means)
        if not round_left or not splits.any():
            return means
        edges = np.sort(np.concatenate([edges, (begin + end)[splits] // 2]))


def first_true(condition, otherwise):
    return int(np.argmax(condition)) if np.any(condition) else otherwise


def rough_curve(insertion, withdrawal):
    # Means, noise of one point, and the values from which the fit starts.
    # The median of second differences: a steady slope does not enter, nor does the break of a layer. 0.455: median of chi squared.
    squares = np.sort(np.diff(insertion[:, 1], 2)**2 / 6)
    noise = np.sqrt(squares[len(squares) // 2] / 0.455)
    means = means_of(insertion, 180, noise)
    refuse_if((len(means) < LEAST_ROWS, f"has {len(means)} different depths, and must have at least {LEAST_ROWS}"))
    depth, force, samples = means.T
    first, rise = force[:3].mean(), force.max() - force[:3].mean()
    fall, least = first - force.min(), max(6 * noise / np.sqrt(samples[0]), 1e-9)
    rises = rise > least and rise > 0.5 * fall
    refuse_if((not rises and fall > least, "the force never rises, it falls; force_N must be positive while the tissue resists the tool"),
              (not rises, f"no contact: the force never rises above its noise of {noise:.3g} N"),
              (abs(first) > rise, f"begins with a force of {first:.3g} N, which then rises by {rise:.3g} N only; it must begin before "
               "contact, with the load cell at 0"))
    above = force > first + 0.05 * rise
    contact = first_true(above[:-1] & above[1:], len(means) - 1)
    behind = depth[-1] - depth[contact]
    refuse_if((behind < 1 or len(means) - contact < 12,
               f"only {behind:.2g} mm lie behind the contact at {depth[contact]:.2f} mm; it must go at least 1 mm deep"))
    rough = SimpleNamespace(insertion=means, noise=noise, contact=depth[contact], deepest=depth[-1], spacing=np.ptp(depth) / (len(means) - 1),
                            withdrawal=means_of(withdrawal, 100, noise) if len(withdrawal) else means[:0], has_baseline=contact >= 5)
    rough.baseline = force[:contact].mean() if rough.has_baseline else 0
    deep = contact + (len(means) - contact) * 2 // 5
    rough.slope, at_contact = np.polyfit(depth[deep:] - rough.contact, force[deep:], 1)
    rough.cutting = max(at_contact - rough.baseline, 0.1 * (force.max() - rough.baseline))
    half = contact + first_true(force[contact:] - rough.baseline >= 0.5 * rough.cutting, len(means) - 1 - contact)
    points = max(half - contact, 1)
    rough.rise_spacing = (depth[contact + points] - rough.contact) / points
    rough.stiffness = max(force[half] - rough.baseline, 0.5 * rough.cutting) / (points * rough.rise_spacing)
    return rough


def tip_and_shaft(stiffness, surface, drift, friction, u):
    # Force at the tip's displacement `u` beyond the surface; the strength is `surface` there and changes by `drift`.
    cut = (stiffness * u - surface) / (stiffness + drift)
    return np.where(cut > 0, surface + (drift + friction) * cut, stiffness * u)


def force_of(p, depth, is_insertion):
    # The solution of the law `cutting` for a steady insertion; friction alone in the withdrawal.
    u, stiffness = depth - p[CONTACT], np.exp(p[LOG_STIFFNESS])
    drift = max(p[DRIFT], -0.5 * stiffness)
    force = tip_and_shaft(stiffness, p[CUTTING] - drift * p[MIDDLE], drift, p[FRICTION], u)
    if p[FALL]:
        past = np.clip((depth - p[LAYER_END]) / p[FALL] + 0.5, 0, 1)
        force = past * force + (1 - past) * tip_and_shaft(stiffness, p[LAYER], 0, p[FRICTION], u)
    return p[BASELINE] + np.where(u > 0, np.where(is_insertion, force, -p[FRICTION] * u), 0)


def first_strength(p):
    # The strength that the tip meets first.
    return p[LAYER] if p[FALL] else max(p[CUTTING] - p[DRIFT] * p[MIDDLE], 0.1 * p[CUTTING])


def rise_of(rough, p):
    # The last depth before the first rise, the first one with 80 % of the strength, and the least stiffness between them.
    depth, force, strength = rough.insertion[:, 0], rough.insertion[:, 1] - p[BASELINE], first_strength(p)
    end = first_true(force > 0.8 * strength, len(depth) - 1)
    before = depth[np.flatnonzero(force[:end] < 0.1 * strength)].max(initial=depth[0])
    return before, depth[end], 0.7 * strength / max(depth[end] - before, 1e-6)


class Problem:
    # The points that the model describes, and the parameters that are free.
    # Left out: the withdrawal near the turning point, where crushed tissue holds the tip; given the earlier solution `bend`, the bend
    # from rising to cutting, because what the tip meets first is rarely as strong as the mean; the fall at the end of a layer. What
    # lies before and behind the bend counts as independent, and so does the withdrawal: they are the branches 0, 1 and 2.

    def __init__(self, rough, diameter, has_layer, bend=None):
        depth, begin, end, kept, self.resolves_rise = rough.insertion[:, 0], np.inf, np.inf, True, True
        if bend is not None:
            begin, end = bend[CONTACT] + np.array([0.6, 1.1]) * first_strength(bend) / np.exp(bend[LOG_STIFFNESS])
            self.resolves_rise = np.sum((depth > bend[CONTACT]) & (depth < begin)) >= 4
            if not self.resolves_rise:
                before, behind, _ = rise_of(rough, bend)
                begin, end = np.nextafter(before, np.inf), 1.5 * behind - 0.5 * before
            fall = 0.6 * bend[FALL] + 0.5 * rough.rise_spacing
            if has_layer and self.resolves_rise and np.sum((depth > end) & (depth < bend[LAYER_END] - fall)) < 4:
                end = begin  # the layer is so thin that its strength shows at the bend alone
            kept = np.abs(depth - bend[LAYER_END]) >= fall if has_layer else True
        turn = max(diameter, 1) + 1.2 * rough.cutting / rough.stiffness
        self.used = kept & ((depth < begin) | (depth > end)), rough.withdrawal[:, 0] < rough.deepest - turn
        self.depth, self.force, self.samples = np.concatenate([rough.insertion[self.used[0]], rough.withdrawal[self.used[1]]]).T
        self.is_insertion = np.arange(len(self.depth)) < self.used[0].sum()
        self.branch = np.where(self.is_insertion, self.depth >= begin, 2)
        self.rough = rough
        free = {CUTTING: True, FRICTION: True, CONTACT: self.resolves_rise, LOG_STIFFNESS: self.resolves_rise, BASELINE: rough.has_baseline,
                DRIFT: len(rough.withdrawal) > 0, LAYER: has_layer, LAYER_END: has_layer and bend is None}  # later the fall is left out
        self.free = [k for k, is_free in free.items() if is_free]

    def fitted(self, p):
        return force_of(p, self.depth, self.is_insertion)

    def jacobian(self, p, free, scale=1):
        # Derivatives of the fitted force by the free parameters, by central differences.
        steps = np.full(len(p), 1e-4 * max(p[CUTTING], 1e-3))
        steps[[FRICTION, DRIFT]] /= np.ptp(self.rough.insertion[:, 0])
        steps[[CONTACT, LAYER_END, LOG_STIFFNESS]] = 0.02 * self.rough.rise_spacing, 0.02 * self.rough.rise_spacing, 1e-4
        return np.stack([(self.fitted(p + step) - self.fitted(p - step)) / (2 * step.sum()) for step in np.diag(scale * steps)[free]], 1)

    def set_amplitudes(self, p):
        # Sizes of the correlated residuals relative to the largest, with and without the friction of the insertion.
        tip = np.where(np.arange(len(p)) == FRICTION, 0, p)
        forces = self.fitted(p), np.where(self.is_insertion, self.fitted(tip), self.fitted(p))
        sizes = [np.abs(force - p[BASELINE]) + 1e-12 for force in forces]
        self.largest = sizes[0].max()
        self.amplitudes = [np.maximum(size / size.max(), 0.03) for size in sizes]  # no tissue is linear at the surface

    def minimise(self, start, free, whitening):
        # The cost, and the parameters.
        def parameters(x):
            p = start.copy()
            p[free] = x
            return np.clip(p, LEAST_OF, MOST_OF)

        done = least_squares(lambda x: whitening @ (self.force - self.fitted(parameters(x))), start[free],
                             lambda x: -whitening @ self.jacobian(parameters(x), free), method="lm", x_scale="jac", ftol=1e-7, max_nfev=300)
        return 2 * done.cost, parameters(done.x)


# The covariance of the residuals of a branch is scale^2 (diag(1 / samples) + ratio^2 a_i a_j k(|z_i - z_j| / length)). a: amplitude
# (`of_tip`: that without friction). k: exponential, or Matern 5/2 if `smooth`.


def modes_of(problem, smooth, of_tip, length):
    # Eigenvalues for scale 1 and ratio 1, less 1, and the matrix that leads to the modes.
    x = np.sqrt(5 if smooth else 1) / length * np.abs(np.subtract.outer(problem.depth, problem.depth))
    k = (1 + x + x * x / 3 if smooth else 1) * np.exp(-x)
    root = 1 / np.sqrt(1 / problem.samples + 1e-9)
    weight = problem.amplitudes[of_tip] * root
    values, vectors = np.linalg.eigh(k * np.outer(weight, weight) * np.equal.outer(problem.branch, problem.branch))
    return np.maximum(values, 0), vectors.T * root


def whitening_of(problem, smooth=False, of_tip=False, length=0.6, ratio=3.0):
    # The matrix that makes residuals uncorrelated, with the variance scale^2.
    values, to_modes = modes_of(problem, smooth, of_tip, length)
    return to_modes / np.sqrt(1 + ratio * ratio * values)[:, None]


def estimate_noise(problem, p, is_rough):
    # The noise of the residuals, and from it the covariance of the free parameters.
    # Weighted means over many covariances. The weight is the restricted likelihood (H. Patterson, R. Thompson, Biometrika 58, 1971),
    # which takes into account that the fit itself made the residuals smaller, times a log-normal prior for the integral of the
    # correlation (median 0.6 mm) and a prior that makes a scale above the noise of neighbouring points less probable. Each covariance
    # contributes that of one generalised least squares step, and the square of this step.
    jacobian, residuals = problem.jacobian(p, problem.free, 10), problem.force - problem.fitted(p)
    freedom, found = max(len(residuals) - len(problem.free), 1), []
    for smooth, of_tip, length in itertools.product(*[(False,) if is_rough else (False, True)] * 2, (0.2, 0.35, 0.6, 1.0, 1.8)):
        values, to_modes = modes_of(problem, smooth, of_tip, length)
        integral = 8 * length / (3 * np.sqrt(5)) if smooth else length  # of k over the distance
        for ratio in (0.1, 0.3, 1, 2, 4, 8, 20, 60, 200, 1000):
            sizes = np.sqrt(1 + ratio * ratio * values)
            a, b = (to_modes @ jacobian) / sizes[:, None], (to_modes @ residuals) / sizes
            unit = 1 / np.sqrt(np.maximum(np.sum(a * a, axis=0), 1e-300))  # the parameters have different units
            scaled = a.T @ a * np.outer(unit, unit) + 1e-12 * np.eye(len(unit))
            inverse = np.linalg.inv(scaled)
            step = unit * (inverse @ (unit * (a.T @ b)))
            squares = max(np.sum((b - a @ step)**2), 1e-300)
            scale = np.sqrt(squares / freedom)
            prior = np.log(integral / 0.6) / 0.5
            excess = max(np.log(scale / max(problem.rough.noise, 1e-9)), 0) / 0.3
            determinant = 2 * np.log(sizes).sum() + np.linalg.slogdet(scaled)[1] - 2 * np.log(unit).sum()
            found.append((-0.5 * (determinant + freedom * np.log(squares) + prior**2 + excess**2), (smooth, of_tip, length, ratio), scale,
                          integral, ratio * scale, inverse * np.outer(unit, unit) * scale**2 + np.outer(step, step)))
    best = max(found, key=lambda each: each[0])
    weighted = [(np.exp(each[0] - best[0]), each) for each in found if each[0] > best[0] - 14]
    integral, structure, covariance = (sum(w * each[i] for w, each in weighted) / sum(w for w, _ in weighted) for i in (3, 4, 5))
    return SimpleNamespace(best=best[1], scale=best[2], integral=integral, structure=structure, covariance=covariance)


def falls_of(rough):
    # Up to three depths in the upper half of the cut at which the force falls most within half a millimetre.
    depth, force, _ = rough.insertion.T
    half, at = max(0.5, 2 * rough.spacing), (depth[1:] + depth[:-1]) / 2
    distance = depth - at[:, None]
    before, after = (distance <= 0) & (distance > -half), (distance > 0) & (distance < half)
    fall = before @ force / np.maximum(before.sum(1), 1) - after @ force / np.maximum(after.sum(1), 1)
    fall[~(before.any(1) & after.any(1) & (at > rough.contact) & (at - rough.contact <= 0.5 * (rough.deepest - rough.contact)))] = 0
    ends = []
    for i in np.argsort(np.diff(force) - fall):
        if fall[i] > 0 and len(ends) < 3 and all(abs(at[i] - end) >= half for end in ends):
            ends.append(at[i])
    return ends


def starts_of(rough, has_layer):
    depth, force, _ = rough.insertion.T
    starts = []
    for end, factor, fall in itertools.product(falls_of(rough), (1, 2.5), (0.3, 2, 8)) if has_layer else ((0, f, 0) for f in (1, 0.4, 3)):
        peak = force[depth <= end].max(initial=rough.baseline) - rough.baseline
        starts.append(np.array([rough.baseline, rough.contact, np.log(factor * rough.stiffness), rough.cutting, max(rough.slope, 0), 0, peak, end,
                                0.5 * (rough.deepest - rough.contact), fall * rough.spacing]))
    return starts


def estimate(rough, diameter, has_layer):
    # Problem, parameters and noise of the fit with or without a layer; None if no start leads to it.
    starts = starts_of(rough, has_layer)
    if not starts:
        return None
    problem = Problem(rough, diameter, has_layer)
    problem.set_amplitudes(starts[0])
    whitening = whitening_of(problem)
    p = min((problem.minimise(start, problem.free, whitening) for start in starts), key=lambda each: each[0])[1]
    problem.set_amplitudes(p)
    found = estimate_noise(problem, p, True)
    for is_rough in (True, False):
        problem = Problem(rough, diameter, has_layer, p)
        if not problem.resolves_rise:  # stiffness and contact stay within what the few points allow
            before, behind, least = rise_of(rough, p)
            p[LOG_STIFFNESS], p[CONTACT] = np.clip(p[LOG_STIFFNESS], *np.log([least, 5 * least])), np.clip(p[CONTACT], before, behind)
        problem.set_amplitudes(p)
        p = problem.minimise(p, problem.free, whitening_of(problem, *found.best))[1]
        problem.set_amplitudes(p)
        found = estimate_noise(problem, p, is_rough)
    return problem, p, found


def choose(rough, diameter):
    # The better of the fits with and without a layer.
    plain, layered = estimate(rough, diameter, False), estimate(rough, diameter, True)
    if layered:
        problem, p, noise = layered
        whitening = whitening_of(problem, *noise.best)
        costs = problem.minimise(plain[1], plain[0].free, whitening)[0], problem.minimise(p, problem.free, whitening)[0]
        if p[LAYER] > p[CUTTING] and costs[0] - costs[1] > 36 * noise.scale**2:
            return layered
    return plain


def thickness_of(problem, p, noise):
    # Thickness of the layer: the depth at which it breaks, less that of the surface and the tip's elastic displacement.
    elastic = p[LAYER] / np.exp(p[LOG_STIFFNESS])
    gradient = np.array([{CONTACT: -1, LOG_STIFFNESS: elastic}.get(k, 0) for k in problem.free])
    value = p[LAYER_END] - p[CONTACT] - elastic
    # The layer breaks at the strength at its end, or its mean strength is not known as well as the depth of the break: the larger of
    # the two. Besides, the fall has a length, and a stiffness of which only a bound is known leaves the elastic displacement open.
    stretches = max(value, 0) / (2 * noise.integral)
    local = np.sqrt(max(1 - np.exp(-stretches), 1 / (1 + stretches))) * noise.structure / problem.largest * elastic
    fall, unknown = max(p[FALL], problem.rough.rise_spacing) / np.sqrt(12), 0 if problem.resolves_rise else elastic
    half = QUANTILE_95 * np.sqrt(gradient @ noise.covariance @ gradient + local**2 + fall**2 + unknown**2)
    return np.maximum([value, value - half, value + half] if half < np.inf else [value, 0, np.inf], 0)


def fit_curve(columns, diameter):
    # The fit. Its `rows` are {name: (unit, [value, low, high])}, with the bounds of the 90 % interval.
    np.seterr(all="ignore")  # parameters that a start lets vanish
    rough = rough_curve(*branches_of(columns))
    if Problem(rough, diameter, False).used[1].sum() < 8:
        rough.withdrawal = rough.withdrawal[:0]
    problem, p, noise = choose(rough, diameter)
    residuals = problem.force - problem.fitted(p)
    explained = 1 - np.sum(residuals**2) / np.sum((problem.force - rough.insertion[:, 1].mean())**2)
    travel, elastic = rough.deepest - p[CONTACT], p[CUTTING] / np.exp(p[LOG_STIFFNESS])
    # A straight rise to the end is fitted as friction alone.
    refuse_if((not explained > 0.5, f"is not like an insertion: the fit explains {100 * max(explained, 0):.0f} % of the force's variance only"),
              (p[CUTTING] < 0.02 * problem.largest or travel - elastic < max(0.2 * travel, 10 * rough.spacing),
               "the force still rises steeply at the end: nothing was cut; the tool must go deeper"))
    half = dict(zip(problem.free, QUANTILE_95 * np.sqrt(noise.covariance.diagonal())))
    rows = {"stiffness before cutting": ("N/mm", [np.exp(p[LOG_STIFFNESS]), rise_of(rough, p)[2], np.inf])}
    for k, name, unit in ((LOG_STIFFNESS, "stiffness before cutting", "N/mm"), (LAYER, "force of the hard layer", "N"),
                          (CUTTING, "cutting force of the tip", "N"), (FRICTION, "friction per length", "N/mm"),
                          (DRIFT, "drift of the cutting force", "N/mm")):
        if k in half:
            interval = np.array([p[k], p[k] - half[k], p[k] + half[k]])
            rows[name] = unit, np.exp(interval) if k == LOG_STIFFNESS else interval if k == DRIFT else np.maximum(interval, 0)
        if k == LAYER and p[FALL]:
            rows["thickness of the hard layer"] = "mm", thickness_of(problem, p, noise)
    return SimpleNamespace(rows=rows, p=p, rough=rough, used=problem.used, residuals=residuals, noise=noise, explained=explained)


def text_of(fit):
    # The parameters with their intervals, and notes, in lines.
    lines = [f"{'parameter':32}{'value':24}90 % interval"]
    for name, (unit, (value, low, high)) in fit.rows.items():
        shown, interval = f"{value:.4g} {unit}", f"{low:.4g} to {high:.4g} {unit}"
        if np.isinf(high):
            shown, interval = f"at least {low:.4g} {unit}", "the rise has too few points"
        lines.append(f"{name:32}{shown:24}{interval}")
    if fit.p[FALL]:
        thickness, factor = fit.rows["thickness of the hard layer"][1][0] * 1e-3, fit.p[LAYER] / fit.p[CUTTING]
        if 1e-4 <= thickness <= 0.01 and 0.1 <= factor <= 100:  # what a scene allows
            lines.append(f'The hard layer, in a scene\'s body: "shell": {{ "thickness_m": {thickness:.4g}, "strength_factor": {factor:.4g} }}')
    lines.append(f"The cutting force holds {fit.p[MIDDLE]:.3g} mm below the surface." if len(fit.rough.withdrawal) else
                 "Without a withdrawal, friction and a drift of the cutting force are one slope.")
    return "\n".join(lines + [
        f"Contact at {fit.p[CONTACT]:.3f} mm; force before contact {fit.p[BASELINE]:.3g} N.",
        f"Residuals: {np.sqrt(np.mean(fit.residuals**2)):.3g} N rms, of which structure {fit.noise.structure:.3g} N correlated over "
        f"{fit.noise.integral:.2g} mm; noise {fit.rough.noise:.3g} N. The fit explains {100 * fit.explained:.1f} % of the variance."])


def tissue_of(fit, tool):
    # The tissue of a scene that gives the fit's forces with this tool (runtime/haptics/bone/bone_volume.h).
    outer, inner, outline = tool
    stiffness, cutting, friction = np.exp(fit.p[LOG_STIFFNESS]), fit.p[CUTTING], max(fit.p[FRICTION], 0)
    cut = {"strength_MPa": cutting / (np.pi * (outer**2 - inner**2)), "modulus_MPa": stiffness * (1 - POISSON**2) / (2 * outer),
           "friction_kPa": 1e3 * friction / (2 * np.pi * (outer + inner) * outline)}
    tissue = {"stiffness_N_per_m": 1e3 * stiffness, "threshold_N": cutting}
    for values in (tissue, cut):
        for key, value in values.items():
            low, high = RANGES[key]
            refuse_if((not low <= value <= high, f"the fitted tissue: {key} is {value:g}, and must be from {low:g} to {high:g}"))
            values[key] = float(f"{value:.5g}")  # more than a fit knows
    return json.dumps({**tissue, "cut": cut}, indent=2) + "\n"


def read_tool(path):
    # Radius of the disc with the tool's area, radius of its bore, and its outline over that of the disc. The file may be a scene.
    try:
        scene = json.loads(pathlib.Path(path).read_text("utf-8"))
        tool = scene["tool"] if "schema" in scene else scene
        angles = np.linspace(0, 2 * np.pi, tool.get("sides", 6), endpoint=False)
        x, y = 1e3 * np.array(tool.get("outline_m") or tool["radius_m"] * np.stack([np.cos(angles), np.sin(angles)], axis=1)).T
        edge_x, edge_y, inner = np.roll(x, -1) - x, np.roll(y, -1) - y, 1e3 * tool.get("inner_radius_m", 0)
        outer = np.sqrt(max(np.sum(x * edge_y - y * edge_x), 0) / (2 * np.pi))
        refuse_if((not 0 <= inner < outer <= 50, "its tool's radii are beyond those of a scene"))
        return outer, inner, np.hypot(edge_x, edge_y).sum() / (2 * np.pi * outer)
    except (AttributeError, KeyError, TypeError, ValueError):
        refuse_if((True, "has neither the tool of a scene nor a scene with a tool, with radius_m or outline_m"))


def figure_of(fit):
    # The curve with the fit, and the residuals.
    import matplotlib.figure  # takes a second
    figure = matplotlib.figure.Figure(figsize=(9, 7))
    above, below = figure.subplots(2, sharex=True, gridspec_kw={"height_ratios": (2, 1)})
    for means, used, is_insertion in zip((fit.rough.insertion, fit.rough.withdrawal), fit.used, (True, False)):
        depth, measured, fitted = means[:, 0], means[:, 1], force_of(fit.p, means[:, 0], is_insertion)
        above.plot(depth[used], measured[used], ".", depth, fitted, "r-", linewidth=1)
        above.plot(depth[~used], measured[~used], ".", color="0.75")
        below.plot(depth[used], (measured - fitted)[used], ".")
    above.set(ylabel="force (N); red: fit, grey: left out")
    below.set(xlabel="depth (mm)", ylabel="measured minus fitted (N)")
    out = io.BytesIO()
    figure.savefig(out)
    return out.getvalue()


def main(words):
    parser = Parser("trocar-fit", f"scipy {scipy.__version__}, numpy {np.__version__}", 'the tissue to write, JSON, for the "tissue" of a scene',
                    description="Makes a tissue for scenes from a measured curve of force over depth.")
    parser.add_argument("curve", metavar="CURVE", help="the curve of an insertion, with or without the withdrawal after it: CSV with the "
                        "columns depth_mm and force_N, and optionally speed_mm_per_s and time_s")
    parser.add_argument("--figure", metavar="FILE.png", help="draw the fitted curve and its residuals: PNG")
    tool = parser.add_mutually_exclusive_group(required=True)
    tool.add_argument("--tool", metavar="FILE", help='JSON file with the tool: a scene, or its "tool" alone')
    tool.add_argument("--gauge", type=int, choices=GAUGES_MM, help="gauge number of the needle, which states its diameter")
    tool.add_argument("--diameter", type=float, default=0, metavar="MM", help="diameter of the tool in mm, 0.2 to 50")
    parser.add_argument("--bore", type=float, default=0, metavar="MM", help="inner diameter of a hollow tool in mm")
    options = parser.parse_args(words)
    diameter = GAUGES_MM.get(options.gauge, options.diameter)
    if not options.tool and not (0.2 <= diameter <= 50 and 0 <= options.bore < diameter):
        raise Failure(USAGE, "--diameter must be from 0.2 to 50, and --bore less than the diameter")
    check_outputs({"-o": options.output, "--figure": options.figure}, [options.curve, options.tool or options.curve])
    with about(options.tool):
        tool = read_tool(options.tool) if options.tool else (diameter / 2, options.bore / 2, 1)
    with about(options.curve), open(options.curve, "rb") as file:
        data = file.read(MOST_BYTES + 1)
        refuse_if((len(data) > MOST_BYTES, f"is larger than {MOST_BYTES} bytes"))
        fit = fit_curve(parse_curve(data.decode("utf-8-sig", "replace")), 2 * tool[0])
        tissue = tissue_of(fit, tool)
    write_file(options.output, tissue.encode())
    if options.figure:
        write_file(options.figure, figure_of(fit))
    if not options.quiet:
        print(text_of(fit))


if __name__ == "__main__":
    run("trocar-fit", main)
