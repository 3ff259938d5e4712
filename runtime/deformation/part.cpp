// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/part.h"

#include <algorithm>
#include <limits>

namespace trocar::runtime {
namespace {

/// Small numbers by slot, in a table that grows with what is in it and not with the sheet.
class SlotTable {
 public:
  SlotTable() : entries_(256) {}

  /// The number of `slot`; `fresh` (and remembered) if it had none.
  std::uint32_t find_or_add(std::uint32_t slot, std::uint32_t fresh) {
    if (2 * used_ >= entries_.size()) grow();
    Entry& entry = place(slot);
    if (entry.slot == kNone) {
      entry = {slot, fresh};
      ++used_;
    }
    return entry.number;
  }
  bool contains(std::uint32_t slot) { return place(slot).slot != kNone; }

 private:
  struct Entry {
    std::uint32_t slot = kNone, number = 0;
  };
  Entry& place(std::uint32_t slot) {
    std::size_t at = (slot * std::size_t{2654435761U}) & (entries_.size() - 1);
    while (entries_[at].slot != kNone && entries_[at].slot != slot)
      at = (at + 1) & (entries_.size() - 1);
    return entries_[at];
  }
  void grow() {
    std::vector<Entry> old(4 * entries_.size());
    old.swap(entries_);
    for (const Entry& entry : old) {
      if (entry.slot != kNone) place(entry.slot) = entry;
    }
  }
  std::vector<Entry> entries_;
  std::size_t used_ = 0;
};

Eigen::Vector2d relative(LatticePoint p, const Eigen::Vector2d& centre) {
  return Eigen::Vector2d(p.x, p.y) - centre;
}

/// Squared distance of a triangle from the origin.
double distance2_to_origin(const std::array<Eigen::Vector2d, 3>& p) {
  double least = std::numeric_limits<double>::infinity();
  bool inside = true;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector2d& a = p[k];
    const Eigen::Vector2d side = p[(k + 1) % 3] - a;
    inside = inside && a.x() * side.y() - a.y() * side.x() >= 0;
    const double t = std::clamp(-a.dot(side) / side.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (a + t * side).squaredNorm());
  }
  return inside ? 0 : least;
}

}  // namespace

Circle circle_around(const Ring& tool) noexcept {
  Circle circle;
  for (const LatticePoint& p : tool)
    circle.centre += Eigen::Vector2d(p.x, p.y) / static_cast<double>(tool.size());
  for (const LatticePoint& p : tool)
    circle.radius = std::max(circle.radius, relative(p, circle.centre).norm());
  return circle;
}

SheetPart part_around(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                      const Circle& circle, double radius, std::vector<std::uint32_t>& queue) {
  SlotTable taken, numbers;
  queue.clear();
  for (std::uint32_t t : seeds) {
    const auto at = static_cast<std::uint32_t>(queue.size());
    if (taken.find_or_add(t, at) == at) queue.push_back(t);
  }
  const double reach = circle.radius + radius;
  SheetPart part;
  for (std::size_t k = 0; k < queue.size(); ++k) {
    const std::uint32_t t = queue[k];
    Triangle corner;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t v = sheet.triangles[t][i];
      const auto fresh = static_cast<std::uint32_t>(part.mesh.vertices.size());
      corner[i] = numbers.find_or_add(v, fresh);
      if (corner[i] == fresh) {
        part.mesh.vertices.push_back(sheet.vertices[v]);
        part.parent.push_back(v);
      }
    }
    part.mesh.triangles.push_back(corner);
    for (std::uint32_t u : sheet.across[t]) {
      if (u == kNone || taken.contains(u)) continue;
      const std::array<LatticePoint, 3> p = corners(sheet, u);
      if (!(distance2_to_origin({relative(p[0], circle.centre), relative(p[1], circle.centre),
                                 relative(p[2], circle.centre)}) < reach * reach))
        continue;
      taken.find_or_add(u, static_cast<std::uint32_t>(queue.size()));
      queue.push_back(u);
    }
  }
  for (std::uint32_t t : queue) {
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t u = sheet.across[t][i];
      if (u == kNone || taken.contains(u)) continue;
      part.outer.push_back(
          {sheet.vertices[sheet.triangles[t][i]], sheet.vertices[sheet.triangles[t][(i + 1) % 3]]});
    }
  }
  std::sort(part.outer.begin(), part.outer.end());
  return part;
}

}  // namespace trocar::runtime
