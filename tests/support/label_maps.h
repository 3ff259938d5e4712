// SPDX-License-Identifier: GPL-3.0-or-later
// Label maps with triple points, thin walls and noise, for the pipeline's tests.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "pipeline/segment/label_pixels.h"
#include "pipeline/segment/segmentation.h"
#include "tests/support/memory_stack.h"

namespace trocar::pipeline {

struct LabelMap {
  std::string name;
  Image image;  ///< labels 0 (none) .. 10
};

inline constexpr int kMapLabels = 10;

/// Each of the labels 1 .. `labels` as a material, in this order.
inline std::vector<Labels> each_label(int labels = kMapLabels) {
  std::vector<Labels> out;
  for (int label = 1; label <= labels; ++label)
    out.push_back({{label}});
  return out;
}

/// Assigns each pixel to the first material that contains its label, or to kNoMaterial. A value
/// that is not a whole number is no label. Precondition: there are at most kMaxMaterials
/// materials. O(pixels).
inline MaterialImage material_image(const Image& labels, std::span<const Labels> materials) {
  MaterialImage out{labels.width, labels.height, {}, {}};
  out.labels.resize(materials.size());
  out.values.reserve(labels.values.size());
  float last = 0;
  MaterialNumber last_material = kNoMaterial;
  bool is_first = true;
  for (const float v : labels.values) {
    if (is_first || v != last) {
      last = v;
      is_first = false;
      last_material = kNoMaterial;
      if (std::rint(v) == v) {
        const int label = static_cast<int>(v);
        const auto has = [label](const Labels& m) {
          return m.all ? label != 0 : m.labels.contains(label);
        };
        const auto it = std::find_if(materials.begin(), materials.end(), has);
        if (it != materials.end()) {
          last_material = static_cast<MaterialNumber>(it - materials.begin() + 1);
          out.labels[static_cast<std::size_t>(it - materials.begin())].insert(label);
        }
      }
    }
    out.values.push_back(last_material);
  }
  return out;
}

/// The nearest of ten sites within an ellipse, with wavy borders: a body of ten organs that meet in
/// triple points.
inline Image organs(int size, std::uint64_t seed) {
  std::mt19937_64 rng(seed);
  const auto uniform = [&rng] { return static_cast<double>(rng() >> 11) * 0x1p-53; };
  std::array<std::array<double, 2>, kMapLabels> sites{};
  for (auto& site : sites)
    site = {size * (0.2 + 0.6 * uniform()), size * (0.25 + 0.5 * uniform())};
  const double phase = 6 * uniform(), wave = size / 9.0;
  return image_of(size, size, [&](int x, int y) {
    const double u = x + 0.02 * size * std::sin(y / wave + phase),
                 v = y + 0.02 * size * std::sin(x / wave - phase);
    if (std::hypot((u - 0.5 * size) / 0.45, (v - 0.5 * size) / 0.38) > size) return 0;
    int best = 0;
    double least = 1e300;
    for (int k = 0; k < kMapLabels; ++k) {
      const double d = std::hypot(u - sites[static_cast<std::size_t>(k)][0],
                                  v - sites[static_cast<std::size_t>(k)][1]);
      if (d < least) least = d, best = k + 1;
    }
    return best;
  });
}

/// Each pixel becomes any of the labels, or none, with the probability `share`.
inline Image salted(Image image, double share, std::uint64_t seed) {
  std::mt19937_64 rng(seed);
  for (float& v : image.values) {
    const bool is_hit = static_cast<double>(rng() >> 11) * 0x1p-53 < share;
    const auto label = static_cast<float>(rng() % (kMapLabels + 1));
    if (is_hit) v = label;
  }
  return image;
}

/// Ten maps with triple points; every one has labels at the image's border or noise, or both.
inline std::vector<LabelMap> ten_label_maps() {
  const auto rings = [](int x, int y) {
    const double r = std::hypot(x - 30.3, y - 29.6);
    const int sector = static_cast<int>(std::floor((std::atan2(y - 29.6, x - 30.3) + 4) * 1.3));
    return r > 28 ? 0 : (static_cast<int>(r / 7) + sector) % kMapLabels + 1;
  };
  const auto stripes = [](int x, int y) {
    return static_cast<int>(std::floor((0.6 * x + 0.8 * y) / 2)) % (kMapLabels + 1);
  };
  return {
      {"organs", organs(96, 1)},
      {"organs to the border", image_of(80, 60, [](int x, int y) { return x / 9 + y / 20 * 3; })},
      {"organs, 2 % salt", salted(organs(96, 2), 0.02, 12)},
      {"organs, 20 % salt", salted(organs(96, 3), 0.2, 13)},
      {"salt only", salted(organs(40, 4), 1, 14)},
      {"sectors of rings", image_of(60, 60, rings)},
      {"sectors of rings, 5 % salt", salted(image_of(60, 60, rings), 0.05, 15)},
      {"walls of two pixels", image_of(64, 48, stripes)},
      {"checkerboard", image_of(24, 24, [](int x, int y) { return (x + y) % 2 == 0 ? 1 : 2; })},
      {"checkerboard of four",
       image_of(25, 23, [](int x, int y) { return 1 + x % 2 + 2 * (y % 2); })},
  };
}

}  // namespace trocar::pipeline
