# SPDX-License-Identifier: Apache-2.0
"""Force-depth curves of known tissues, made without the code that fits them: the tool moves in steps of 5 um, and in each step the front
advances until the tip's force no longer exceeds the strength there. Lengths in mm, forces in N."""
import dataclasses
import math

import numpy as np

STEP, CUT_STEP, STRUCTURE_STEP = 0.005, 0.001, 0.02


@dataclasses.dataclass
class Tissue:
    stiffness: float = 300
    cutting: float = 60
    friction: float = 2  # per length
    drift: float = 0  # begins at the surface, where the strength is `cutting`
    layer: float = 0
    thickness: float = 0


@dataclasses.dataclass
class Machine:
    contact: float = 2
    travel: float = 25
    spacing: float = 0.05
    baseline: float = 0.5
    noise: float = 0.5
    structure: float = 0.05  # relative standard deviation of strength or force
    kind: str = "knots"
    is_of_force: bool = False  # the structure is a factor on the force, not on the strength
    withdraws: bool = False
    diameter: float = 3


def random_depth(kind, length, random):
    """A random function of depth, in steps of STRUCTURE_STEP, with unit variance and correlated over about 1 mm."""
    n = int(length / STRUCTURE_STEP) + 2
    if kind == "knots":  # straight between independent values at each millimetre
        knots = random.normal(size=int(length) + 3) / math.sqrt(2 / 3)
        return np.interp(np.arange(n) * STRUCTURE_STEP, np.arange(len(knots)), knots)
    if kind == "rough":  # an Ornstein-Uhlenbeck process of length 0.5 mm
        keep, values = math.exp(-STRUCTURE_STEP / 0.5), random.normal(size=n)
        for i in range(1, n):
            values[i] = keep * values[i - 1] + math.sqrt(1 - keep * keep) * values[i]
        return values
    kernel = np.exp(-0.5 * (np.arange(-60, 61) * STRUCTURE_STEP / 0.35)**2)  # white noise smoothed by a Gaussian of 0.35 mm
    return np.convolve(random.normal(size=n + 120), kernel / np.linalg.norm(kernel), "valid")


def synthetic_curve(tissue, machine, random):
    """{column: values}, as trocar_fit.parse_curve() gives them."""
    def structure():
        values = random_depth(machine.kind, machine.travel + 1, random)
        return lambda depth: values[min(int(max(depth, 0) / STRUCTURE_STEP), len(values) - 1)]
    strength, friction, back = structure(), structure(), structure()
    of_strength, of_force = (0, machine.structure) if machine.is_of_force else (machine.structure, 0)
    points, cut, shaft, tip, then = [], 0.0, 0.0, 0.0, random.uniform(0, machine.spacing)
    deepest = machine.contact + machine.travel
    for k in range(math.ceil(deepest / STEP)):
        u = k * STEP - machine.contact
        while True:
            nominal = tissue.layer if cut < tissue.thickness else tissue.cutting + tissue.drift * cut
            tip = tissue.stiffness * max(u - cut, 0)
            if tip <= nominal * (1 + of_strength * strength(cut)):
                break
            shaft += tissue.friction * (1 + of_strength * friction(cut)) * CUT_STEP
            cut += CUT_STEP
        if k * STEP >= then:
            then += machine.spacing
            points.append((k * STEP, machine.baseline + (tip + shaft) * (1 + of_force * strength(u))))
    for up in np.arange(random.uniform(0, machine.spacing), deepest, machine.spacing) if machine.withdraws else ():
        u = machine.travel - up
        hold = 0.25 * tissue.cutting * max(1 - up / machine.diameter, 0)
        slides = min(max(1 - 2 * up / 0.2, -1), 1)
        force = max(tip - tissue.stiffness * up, -hold) + slides * tissue.friction * max(u, 0) * (1 + machine.structure * back(u))
        points.append((machine.contact + u, machine.baseline + (force if u > 0 else 0)))
    depth, force = np.transpose(points)
    return {"depth_mm": depth, "force_N": force + random.normal(0, machine.noise, len(force))}
