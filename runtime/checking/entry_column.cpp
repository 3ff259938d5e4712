// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/entry_column.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>

#include "formats/session/scene.h"

namespace trocar::runtime {
namespace {

constexpr double kCell_mm = 1;
constexpr std::size_t kMaxCells = 400'000;

/// A grid over the slice plane that covers the material of all slices.
class Cells {
 public:
  Cells(const Asset& asset, const std::vector<Level>& levels) {
    const Eigen::AlignedBox2d box = material_box(asset, levels);
    low_ = box.min();
    const double width_mm = box.sizes()[0], height_mm = box.sizes()[1];
    cell_mm_ = std::max(kCell_mm, std::sqrt((width_mm + kCell_mm) * (height_mm + kCell_mm) /
                                            static_cast<double>(kMaxCells)));
    count_ = {static_cast<int>(width_mm / cell_mm_) + 1,
              static_cast<int>(height_mm / cell_mm_) + 1};
    const double step_mm = asset.lattice.step_mm();
    for (const Level& level : levels)
      material_.push_back(filled(level, step_mm));
  }

  std::size_t size() const { return static_cast<std::size_t>(count_[0]) * count_[1]; }
  std::array<double, 2> middle_mm(std::size_t cell) const {
    const auto i = static_cast<int>(cell);
    const int column = i % count_[0], row = i / count_[0];
    return {low_[0] + (column + 0.5) * cell_mm_, low_[1] + (row + 0.5) * cell_mm_};
  }

  /// Returns, for each cell, whether everything within the radius around it is material.
  std::vector<std::uint8_t> clear(std::size_t level, double radius_mm) const {
    std::vector<std::uint8_t> out(size());
    const int margin = static_cast<int>(std::ceil(radius_mm / cell_mm_));
    for (int y = margin; y < count_[1] - margin; ++y) {
      for (int x = margin; x < count_[0] - margin; ++x)
        out[index(x, y)] = is_clear(material_[level], x, y, margin, radius_mm) ? 1 : 0;
    }
    return out;
  }

 private:
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * count_[0] + x; }

  bool is_clear(const std::vector<std::uint8_t>& material, int x, int y, int margin,
                double radius_mm) const {
    if (material[index(x, y)] == 0) return false;
    for (int dy = -margin; dy <= margin; ++dy) {
      for (int dx = -margin; dx <= margin; ++dx) {
        if (std::hypot(dx, dy) * cell_mm_ > radius_mm + cell_mm_ / 2) continue;
        if (material[index(x + dx, y + dy)] == 0) return false;
      }
    }
    return true;
  }

  std::vector<std::uint8_t> filled(const Level& level, double step_mm) const {
    std::vector<std::uint8_t> material(size());
    const SliceMesh& mesh = level.slice->mesh;
    for (const Triangle& triangle : mesh.triangles) {
      std::array<std::array<double, 2>, 3> p;
      for (std::size_t k = 0; k < 3; ++k) {
        const LatticePoint corner = mesh.vertices[triangle[k]];
        p[k] = {(corner.x * step_mm - low_[0]) / cell_mm_,
                (corner.y * step_mm - low_[1]) / cell_mm_};
      }
      const auto [y0, y1] = std::minmax({p[0][1], p[1][1], p[2][1]});
      const auto [x0, x1] = std::minmax({p[0][0], p[1][0], p[2][0]});
      for (int y = std::max(0, static_cast<int>(y0 - 0.5)); y < count_[1] && y + 0.5 <= y1; ++y) {
        for (int x = std::max(0, static_cast<int>(x0 - 0.5)); x < count_[0] && x + 0.5 <= x1; ++x) {
          const auto side = [&](std::size_t a, std::size_t b) {
            return (p[b][0] - p[a][0]) * (y + 0.5 - p[a][1]) -
                   (p[b][1] - p[a][1]) * (x + 0.5 - p[a][0]);
          };
          if (side(0, 1) >= 0 && side(1, 2) >= 0 && side(2, 0) >= 0) material[index(x, y)] = 1;
        }
      }
    }
    return material;
  }

  Eigen::Vector2d low_;
  std::array<int, 2> count_{1, 1};
  double cell_mm_ = kCell_mm;
  std::vector<std::vector<std::uint8_t>> material_;  ///< one mask of cells with material per level
};

/// Returns the mean spacing of the slices from one level to a lower one.
double spacing_mm(const Level& above, const Level& below) {
  return (above.z_mm - below.z_mm) / (static_cast<double>(slices_between(above, below)) - 1);
}

/// Returns the last level of the window of levels that begins with `first`.
std::size_t window_end(const std::vector<Level>& levels, std::size_t first, double height_mm,
                       double max_gap_mm) {
  std::size_t last = first;
  while (last + 1 < levels.size() && levels[first].z_mm - levels[last + 1].z_mm <= height_mm &&
         slices_between(levels[first], levels[last + 1]) <= kMaxSceneSlices &&
         levels[last].z_mm - levels[last + 1].z_mm <= max_gap_mm)
    ++last;
  return last;
}

/// Rank of a cell: thickness in a window of levels, thickness for a wider tool, and closeness
/// to the centre.
using Score = std::tuple<double, double, double>;

struct Best {
  Score score{0, 0, 0};
  std::optional<EntryColumn> column;
};

using Clearance = std::vector<std::vector<std::uint8_t>>;  ///< indexed by level and cell

/// Compares the cells of the window [first, last] with the best so far.
void search_window(const std::vector<Level>& levels, const Cells& cells, const Clearance& clear,
                   const Clearance& wide, const std::vector<double>& thickness_mm,
                   std::size_t first, std::size_t last, Best& best) {
  std::vector<double> thickness(cells.size()), wide_thickness(cells.size());
  constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  // By cell: the lowest level with material so far, and whether the column's bone has ended.
  std::vector<std::size_t> lowest(cells.size(), kNone), end(cells.size(), kNone);
  std::vector<std::uint8_t> has_ended(cells.size());
  for (std::size_t i = 0; i <= last; ++i) {
    for (std::size_t c = 0; c < cells.size(); ++c) {
      if (clear[i][c] == 0) continue;
      const bool is_apart =
          lowest[c] != kNone && gap_mm(levels[lowest[c]], levels[i]) > kMaxBoneGap_mm;
      lowest[c] = i;
      if (is_apart) has_ended[c] = 1;
      if (has_ended[c] != 0 || i < first) continue;
      end[c] = i;
      thickness[c] += thickness_mm[i];
      wide_thickness[c] += wide[i][c] != 0 ? thickness_mm[i] : 0;
    }
  }
  std::array<double, 2> sum{};
  double total = 0;
  for (std::size_t c = 0; c < cells.size(); ++c) {
    sum[0] += thickness[c] * cells.middle_mm(c)[0];
    sum[1] += thickness[c] * cells.middle_mm(c)[1];
    total += thickness[c];
  }
  for (std::size_t c = 0; total > 0 && c < cells.size(); ++c) {
    if (!(thickness[c] > 0)) continue;
    const std::array<double, 2> at = cells.middle_mm(c);
    const Score score{thickness[c], wide_thickness[c],
                      -std::hypot(at[0] - sum[0] / total, at[1] - sum[1] / total)};
    if (best.column && !(score > best.score)) continue;
    best.score = score;
    best.column = EntryColumn{at, first, end[c], thickness[c], {}};
    for (const auto& level : clear)
      best.column->has_material.push_back(level[c]);
  }
}

}  // namespace

double gap_mm(const Level& above, const Level& below) {
  return spacing_mm(above, below) * (static_cast<double>(slices_between(above, below)) - 2);
}

std::size_t slices_between(const Level& a, const Level& b) {
  return static_cast<std::size_t>(std::abs(a.slice->index - b.slice->index)) + 1;
}

Eigen::AlignedBox2d material_box(const Asset& asset, const std::vector<Level>& levels) {
  const double step_mm = asset.lattice.step_mm();
  Eigen::AlignedBox2d box;
  for (const Level& level : levels) {
    for (const LatticePoint p : level.slice->mesh.vertices)
      box.extend(Eigen::Vector2d(p.x * step_mm, p.y * step_mm));
  }
  return box;
}

std::optional<EntryColumn> find_entry_column(const Asset& asset, const std::vector<Level>& levels,
                                             double radius_mm, double height_mm,
                                             double max_gap_mm) {
  const Cells cells(asset, levels);
  Clearance clear, wide;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    clear.push_back(cells.clear(i, radius_mm));
    wide.push_back(cells.clear(i, 3 * radius_mm));
  }
  const std::vector<double> thickness_mm = level_thickness(levels, max_gap_mm);
  Best best;
  std::size_t earlier_last = 0;
  for (std::size_t first = 0; first < levels.size(); ++first) {
    const std::size_t last = window_end(levels, first, height_mm, max_gap_mm);
    // The windows that follow are parts of this one.
    if (first > 0 && last + 1 == levels.size() && last == earlier_last) break;
    earlier_last = last;
    search_window(levels, cells, clear, wide, thickness_mm, first, last, best);
  }
  if (!best.column) return std::nullopt;
  EntryColumn& found = *best.column;
  while (found.has_material[found.first] == 0)
    ++found.first;
  while (found.has_material[found.last] == 0)
    --found.last;
  return best.column;
}

std::vector<double> level_thickness(const std::vector<Level>& levels, double max_gap_mm) {
  const std::size_t n = levels.size();
  std::vector<double> thickness_mm(n, 1);
  for (std::size_t i = 0; n > 1 && i < n; ++i) {
    const double above = i > 0 ? spacing_mm(levels[i - 1], levels[i]) : 0;
    const double below = i + 1 < n ? spacing_mm(levels[i], levels[i + 1]) : 0;
    thickness_mm[i] = (std::min(i > 0 ? above : below, max_gap_mm) +
                       std::min(i + 1 < n ? below : above, max_gap_mm)) /
                      2;
  }
  return thickness_mm;
}

}  // namespace trocar::runtime
