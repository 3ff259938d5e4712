# SPDX-License-Identifier: Apache-2.0
"""A torso of simple bodies with the HU of a CT: skin, fat, muscle, lungs with vessels, liver, kidneys, aorta, gas, a spine of vertebrae and discs,
and ribs. Tissue is textured, and the scan has noise."""
import numpy as np

SPACING_MM = (1.5, 1.5, 2.5)
SIZE_MM = (360, 250, 160)
NOISE_HU = 20


def smooth_noise(shape, width, random):
    """Noise of standard deviation 1, the mean of `width` voxels along each axis."""
    noise = random.standard_normal(shape).astype(np.float32)
    for axis in range(3):
        sums = np.cumsum(np.concatenate([noise, noise.take(range(width), axis)], axis), axis)
        count = noise.shape[axis]
        noise = (sums.take(range(width, width + count), axis) - sums.take(range(count), axis)) / width
    return noise / noise.std()


def torso():
    """int16 HU [z, y, x]: x to the patient's right, y to the front, z to the head. nifti() of exported.py takes them."""
    random = np.random.default_rng(7)
    nx, ny, nz = (round(size / pitch) for size, pitch in zip(SIZE_MM, SPACING_MM))
    z, y, x = np.meshgrid((np.arange(nz) + 0.5) * SPACING_MM[2], (np.arange(ny) + 0.5) * SPACING_MM[1] - SIZE_MM[1] / 2,
                          (np.arange(nx) + 0.5) * SPACING_MM[0] - SIZE_MM[0] / 2, indexing="ij")

    def ellipse(x0, y0, a, b):
        return np.hypot((x - x0) / a, (y - y0) / b)
    hu = np.full(z.shape, -1000, np.float32)
    fine, coarse = smooth_noise(z.shape, 2, random), smooth_noise(z.shape, 6, random)

    def fill(where, mean, texture):
        hu[where] = (mean + texture * (fine + coarse))[where]
    fill(ellipse(0, 0, 165, 112) < 1, -100, 8)  # skin and fat
    fill(ellipse(0, 0, 155, 102) < 1, 50, 12)
    fill((ellipse(0, 8, 130, 80) < 1) & (ellipse(0, -60, 60, 50) > 1), -20, 40)
    for side in (-1, 1):
        dome = 95 - 55 * ellipse(65 * side, 25, 75, 80)**2  # the diaphragm
        fill((ellipse(70 * side, 15, 58, 62) < 1) & (z > dome), -820, 40)
        fill(ellipse(75 * side, -35, 24, 30) + ((z - 45) / 35)**2 < 1, 35, 12)
    for at in random.uniform((-110, -30, 90), (110, 60, 155), (80, 3)):  # vessels of the lungs
        fill((np.hypot(np.hypot(x - at[0], y - at[1]), (z - at[2]) / 2) < 4) & (hu < -500), 40, 10)
    fill((ellipse(60, 25, 70, 55) < 1) & (z < 75), 60, 12)
    for at in random.uniform((-90, -10, 0), (0, 60, 60), (12, 3)):
        fill(np.hypot(np.hypot(x - at[0], y - at[1]), z - at[2]) < 9, -900, 0)
    fill(ellipse(-12, -28, 11, 11) < 1, 180, 5)
    # Ribs: rings around the chest that sink to the front.
    ring, height = ellipse(0, 5, 140, 92), z + 0.25 * (y + 100)
    for level in range(20, 260, 27):
        away = np.hypot((ring - 1) * 105, height - level)
        fill((away < 7) & (np.abs(x) > 20), 700, 60)
        fill((away < 4.5) & (np.abs(x) > 20), 250, 60)
    # The spine: bodies of 27 mm and discs of 8 mm, a canal, and processes.
    at = z % 35
    body, canal = ellipse(0, -52, 23, 17), ellipse(0, -79, 10, 8)
    arch = (ellipse(0, -80, 18, 15) < 1) | ((np.abs(x) < 4) & (y < -90) & (y > -108) & (at > 5) & (at < 24)) | ((np.abs(y + 76) < 6) & (np.abs(x) < 38) & (at > 10) & (at < 22))
    fill((body < 1) & (at < 27), 220, 40)
    fill((body < 1) & (((body > 0.92) & (at < 27)) | (at < 3) | ((at > 24) & (at < 27))), 600, 60)
    fill((body < 1) & (at >= 27), 90, 10)
    fill(arch, 550, 60)
    fill(canal < 1, 25, 8)
    hu += NOISE_HU * random.standard_normal(hu.shape)
    return np.clip(np.round(hu), -1024, 3000).astype(np.int16)
