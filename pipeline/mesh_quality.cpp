// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh_quality.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar::pipeline {
namespace {

constexpr double kSmallInputAngle_deg = 60;

double angle_at(LatticePoint v, LatticePoint p, LatticePoint q) {
  return std::atan2(static_cast<double>(orient2d(v, p, q)),
                    static_cast<double>(diametral_dot(p, q, v)));
}

class SmallInputAngles {
 public:
  SmallInputAngles(const Refined& refined, double limit_deg)
      : refined_(refined), limit_deg_(limit_deg), at_vertex_(refined.mesh.vertices.size(), 0) {
    for (const Refined::Segment& s : refined.segments) {
      if (s.angle_at_from_deg < limit_deg) at_vertex_[s.from] = 1;
    }
  }

  bool touches(const Triangle& t) const {
    if (at_vertex_[t[0]] || at_vertex_[t[1]] || at_vertex_[t[2]]) return true;
    const std::vector<LatticePoint>& p = refined_.mesh.vertices;
    std::size_t k = 0;
    for (std::size_t i = 1; i < 3; ++i) {
      if (distance2(p[t[i]], p[t[(i + 1) % 3]]) < distance2(p[t[k]], p[t[(k + 1) % 3]])) k = i;
    }
    return meet(refined_.origins[t[k]].segment, refined_.origins[t[(k + 1) % 3]].segment);
  }

 private:
  bool meet(std::int32_t s, std::int32_t t) const {
    const auto small = [this](std::int32_t a, std::int32_t b) {
      const Refined::Segment& segment = refined_.segments[static_cast<std::size_t>(b)];
      return segment.previous == a && segment.angle_at_from_deg < limit_deg_;
    };
    return s >= 0 && t >= 0 && (small(s, t) || small(t, s));
  }

  const Refined& refined_;
  double limit_deg_;
  std::vector<char> at_vertex_;
};

}  // namespace

MeshQuality measure_quality(const Refined& refined, const Lattice& lattice, double min_angle_deg) {
  MeshQuality out;
  if (refined.mesh.triangles.empty()) return out;
  const SmallInputAngles small(refined, kSmallInputAngle_deg),
      unavoidable(refined, min_angle_deg + kLatticeAllowance_deg);
  const double cosine = std::cos(min_angle_deg * std::numbers::pi / 180);
  double min_angle = std::numbers::pi;
  std::int64_t max_doubled_area = 0;
  for (const Triangle& t : refined.mesh.triangles) {
    const LatticePoint a = refined.mesh.vertices[t[0]], b = refined.mesh.vertices[t[1]],
                       c = refined.mesh.vertices[t[2]];
    max_doubled_area = std::max(max_doubled_area, orient2d(a, b, c));
    min_angle = std::min({min_angle, angle_at(a, b, c), angle_at(b, c, a), angle_at(c, a, b)});
    if (is_angle_below(a, b, c, cosine * cosine)) {
      ++out.below_min_angle;
      if (small.touches(t)) ++out.below_at_small_input_angle;
      if (!unavoidable.touches(t)) ++out.below_unexplained;
    }
  }
  out.min_angle_deg = min_angle * 180 / std::numbers::pi;
  out.max_area_mm2 =
      0.5 * static_cast<double>(max_doubled_area) * lattice.step_mm() * lattice.step_mm();
  return out;
}

}  // namespace trocar::pipeline
