// SPDX-License-Identifier: Apache-2.0
// Checks of an outline from the pixels of its picture alone.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "formats/mesh/slice_mesh.h"

namespace trocar::test {

/// A flag for each pixel that is material, and the positions of pixel centres on the lattice.
struct PixelTruth {
  int width = 0, height = 0;
  std::vector<bool> material;
  double step_u = 0, step_v = 0;   ///< size of a pixel, in lattice steps
  int offset_x = 0, offset_y = 0;  ///< in pixels
  bool as_chains = false;          ///< outlined through pixel centres, else between them
  bool half_way = false;           ///< a mask: outlined exactly half way between centres

  /// Is the pixel material? Pixels outside the picture are not.
  bool at(int x, int y) const {
    return x >= 0 && y >= 0 && x < width && y < height &&
           material[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                    static_cast<std::size_t>(x)];
  }
};

/// Describes the first pixel whose centre is on the wrong side of the outline, or "". With chains a
/// wall of one pixel has no width: only pixels without material, and those surrounded by it, are
/// checked.
inline std::string wrong_pixel(const PixelTruth& truth, const Pslg& outline) {
  const auto row_at = [&](int y) { return std::nearbyint((y + truth.offset_y) * truth.step_v); };
  const auto column_at = [&](int x) { return std::nearbyint((x + truth.offset_x) * truth.step_u); };
  // The crossings of each row from left to right: position, and change of the winding number.
  std::vector<std::vector<std::pair<double, int>>> rows(static_cast<std::size_t>(truth.height));
  for (const Ring& ring : outline.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
      const double low = std::min(a.y, b.y), high = std::max(a.y, b.y);
      const int first = static_cast<int>(std::floor(low / truth.step_v)) - truth.offset_y - 1;
      const int last = static_cast<int>(std::ceil(high / truth.step_v)) - truth.offset_y + 1;
      for (int y = std::max(0, first); y <= std::min(truth.height - 1, last); ++y) {
        const double at = row_at(y);
        if ((a.y > at) == (b.y > at)) continue;
        const double x = a.x + (at - a.y) * (double(b.x) - a.x) / (double(b.y) - a.y);
        rows[static_cast<std::size_t>(y)].emplace_back(x, b.y > a.y ? -1 : 1);
      }
    }
  }
  for (int y = 0; y < truth.height; ++y) {
    auto& row = rows[static_cast<std::size_t>(y)];
    std::sort(row.begin(), row.end());
    int winding = 0;
    std::size_t next = 0;
    for (int x = 0; x < truth.width; ++x) {
      for (; next < row.size() && row[next].first < column_at(x); ++next)
        winding += row[next].second;
      bool is_known = !truth.as_chains || !truth.at(x, y);
      if (!is_known) {
        is_known = true;
        for (int j = -1; j <= 1; ++j) {
          for (int i = -1; i <= 1; ++i)
            is_known = is_known && truth.at(x + i, y + j);
        }
      }
      if (is_known && winding != (truth.at(x, y) ? 1 : 0))
        return "pixel (" + std::to_string(x) + ", " + std::to_string(y) + ") has winding number " +
               std::to_string(winding);
    }
  }
  return "";
}

/// Twice the outline's area in steps squared, where the pixels determine it: for chains from the
/// squares and half squares between pixel centres, for masks from their parts cut half way between
/// centres, with the two material corners of a saddle joined. None otherwise, or if it is not an
/// integer.
inline std::optional<std::int64_t> exact_doubled_area(const PixelTruth& truth) {
  if (!truth.as_chains && !truth.half_way) return std::nullopt;
  std::int64_t eighths = 0;
  for (int y = -1; y < truth.height; ++y) {
    for (int x = -1; x < truth.width; ++x) {
      const bool a = truth.at(x, y), b = truth.at(x + 1, y), c = truth.at(x + 1, y + 1),
                 d = truth.at(x, y + 1);
      const int corners = int{a} + int{b} + int{c} + int{d};
      const bool saddle = corners == 2 && a == c;
      if (truth.as_chains) {
        eighths += corners == 4 ? 8 : corners == 3 ? 4 : 0;
      } else {
        eighths += corners == 1   ? 1
                   : corners == 2 ? (saddle ? 6 : 4)
                   : corners == 3 ? 7
                   : corners == 4 ? 8
                                  : 0;
      }
    }
  }
  const double doubled = static_cast<double>(eighths) / 4 * truth.step_u * truth.step_v;
  const bool is_whole = std::fmod(truth.step_u, 2) == 0 && std::fmod(truth.step_v, 2) == 0;
  if (!is_whole || doubled > 1e15) return std::nullopt;
  return static_cast<std::int64_t>(doubled);
}

}  // namespace trocar::test
