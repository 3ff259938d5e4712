// SPDX-License-Identifier: GPL-3.0-or-later
// Fields with known or difficult outlines, for the pipeline's tests.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

/// A disc of value 100; iso 50 is its boundary. Sharp: the share of each pixel that it covers
/// (exact in v, by 64 strips in u). Blurred: a Gaussian edge of that many pixels.
inline Field disc_field(int size, double cx, double cy, double radius, double blur_px = 0) {
  Field field{{size, size, {}}, 50};
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const double outside = std::hypot(x - cx, y - cy) - radius;
      double share = outside < 0 ? 1 : 0;
      if (blur_px > 0) {
        share = 0.5 * std::erfc(outside / (std::numbers::sqrt2 * blur_px));
      } else if (std::abs(outside) < 1) {
        share = 0;
        for (int i = 0; i < 64; ++i) {
          const double u = x + (i - 31.5) / 64 - cx;
          const double half = std::sqrt(std::max(0.0, radius * radius - u * u));
          share += std::max(0.0, std::min(y + 0.5, cy + half) - std::max(y - 0.5, cy - half)) / 64;
        }
      }
      field.image.values.push_back(static_cast<float>(100 * share));
    }
  }
  return field;
}

/// White noise smoothed by `passes` 3 x 3 box filters; its mean is near iso 0. Few passes give
/// specks and one-pixel necks, many give blobs. `rounded` values are integers, so that many sit
/// exactly on the iso-value.
inline Field noise_field(int size, int passes, std::uint64_t seed, bool rounded = false) {
  std::mt19937_64 rng(seed);
  std::vector<float> v(static_cast<std::size_t>(size) * size);
  for (float& f : v)
    f = static_cast<float>(static_cast<double>(rng() >> 11) * 0x1p-53 - 0.5);
  const auto clamp = [size](int k) { return std::min(std::max(k, 0), size - 1); };
  for (int pass = 0; pass < passes; ++pass) {
    std::vector<float> w(v.size());
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        float sum = 0;
        for (int j = -1; j <= 1; ++j) {
          for (int i = -1; i <= 1; ++i)
            sum += v[static_cast<std::size_t>(clamp(y + j)) * size + clamp(x + i)];
        }
        w[static_cast<std::size_t>(y) * size + x] = sum / 9;
      }
    }
    v = std::move(w);
  }
  if (rounded) {
    for (float& f : v)
      f = std::rint(f * 6 * static_cast<float>(passes + 1));
  }
  return {{size, size, std::move(v)}, 0};
}

}  // namespace trocar::pipeline
