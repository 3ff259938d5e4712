// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/mesh_quality.h"

#include <numbers>

namespace trocar {
namespace {

constexpr double kExplainingAngle_deg = 60;

double angle_at(LatticePoint v, LatticePoint p, LatticePoint q) {
  return std::atan2(static_cast<double>(orient2d(v, p, q)),
                    static_cast<double>(diametral_dot(p, q, v)));
}

class SmallInputAngles {
 public:
  explicit SmallInputAngles(const Refined& refined)
      : refined_(refined), at_vertex_(refined.mesh.vertices.size(), -1) {
    for (std::size_t s = 0; s < refined.segments.size(); ++s) {
      if (refined.segments[s].angle_at_from_deg < kExplainingAngle_deg)
        at_vertex_[refined.segments[s].from] = static_cast<std::int32_t>(s);
    }
  }

  // The segment that starts at the smallest input angle below 60 degrees that the triangle touches,
  // or -1.
  std::int32_t at(const Triangle& t) const {
    std::int32_t best = -1;
    for (const std::uint32_t v : t)
      best = smaller(best, at_vertex_[v]);
    const std::vector<LatticePoint>& p = refined_.mesh.vertices;
    const std::uint32_t k = shortest_edge({p[t[0]], p[t[1]], p[t[2]]}).edge;
    const std::int32_t a = refined_.origins[t[k]].segment,
                       b = refined_.origins[t[next_corner(k)]].segment;
    if (a >= 0 && b >= 0) {
      if (segment(b).previous == a && angle(b) < kExplainingAngle_deg) best = smaller(best, b);
      if (segment(a).previous == b && angle(a) < kExplainingAngle_deg) best = smaller(best, a);
    }
    return best;
  }

 private:
  const Refined::Segment& segment(std::int32_t s) const {
    return refined_.segments[static_cast<std::size_t>(s)];
  }
  double angle(std::int32_t s) const { return s < 0 ? 360 : segment(s).angle_at_from_deg; }
  std::int32_t smaller(std::int32_t a, std::int32_t b) const { return angle(b) < angle(a) ? b : a; }

  const Refined& refined_;
  std::vector<std::int32_t> at_vertex_;  // segment that starts at the vertex's small angle, or -1
};

}  // namespace

std::uint32_t count_negative_stiffness_edges(const SliceMesh& mesh) {
  // The angle at a, opposite bc: its cotangent is dot / cross.
  struct Cotangent {
    std::int64_t dot, cross;
  };
  const auto opposite = [&](EdgeId e) {
    const Triangle& t = mesh.triangles[triangle_of(e)];
    const std::uint32_t i = index_of(e);
    const LatticePoint b = mesh.vertices[t[i]], c = mesh.vertices[t[next_corner(i)]],
                       a = mesh.vertices[t[previous_corner(i)]];
    return Cotangent{diametral_dot(b, c, a), orient2d(a, b, c)};
  };
  const Neighbours beyond = neighbours(mesh);
  std::uint32_t out = 0;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const EdgeId here = edge_id(t, i), there = beyond[t][i];
      if (there < here) continue;  // already counted
      const Cotangent p = opposite(here);
      const Cotangent q = there == kNoEdge ? Cotangent{0, 1} : opposite(there);
      if (Int128{p.dot} * q.cross + Int128{q.dot} * p.cross < 0) ++out;
    }
  }
  return out;
}

MeshQuality measure_quality(const Refined& refined, const Lattice& lattice, double min_angle_deg) {
  MeshQuality out;
  if (refined.mesh.triangles.empty()) return out;
  const SmallInputAngles small(refined);
  const double sine = std::sin(min_angle_deg * std::numbers::pi / 180);
  double min_angle = std::numbers::pi, smallest_sine2 = 1;
  std::int64_t max_doubled_area = 0;
  for (std::uint32_t k = 0; k < refined.mesh.triangles.size(); ++k) {
    const Triangle& t = refined.mesh.triangles[k];
    const LatticePoint a = refined.mesh.vertices[t[0]], b = refined.mesh.vertices[t[1]],
                       c = refined.mesh.vertices[t[2]];
    max_doubled_area = std::max(max_doubled_area, orient2d(a, b, c));
    const bool is_sharp = is_angle_below(a, b, c, sine * sine);
    // Angles are expensive: compute them only if the triangle is sharp or may have the smallest
    // one.
    if (!is_sharp && !is_angle_below(a, b, c, smallest_sine2 * (1 + 1e-9))) continue;
    const double angle = std::min({angle_at(a, b, c), angle_at(b, c, a), angle_at(c, a, b)});
    if (angle < min_angle) {
      min_angle = angle;
      smallest_sine2 = std::sin(angle) * std::sin(angle);
    }
    if (!is_sharp) continue;
    SharpTriangle sharp{k, angle * 180 / std::numbers::pi, 360, {}};
    if (const std::int32_t s = small.at(t); s >= 0) {
      const Refined::Segment& segment = refined.segments[static_cast<std::size_t>(s)];
      sharp.input_angle_deg = segment.angle_at_from_deg;
      sharp.input_corner = refined.mesh.vertices[segment.from];
    }
    ++out.below_min_angle;
    if (sharp.input_angle_deg < kExplainingAngle_deg) ++out.below_at_small_input_angle;
    if (sharp.input_angle_deg >= min_angle_deg + kLatticeAllowance_deg) ++out.below_unexplained;
    out.sharp.push_back(sharp);
  }
  out.negative_stiffness_edges = count_negative_stiffness_edges(refined.mesh);
  out.min_angle_deg = min_angle * 180 / std::numbers::pi;
  out.max_area_mm2 =
      0.5 * static_cast<double>(max_doubled_area) * lattice.step_mm() * lattice.step_mm();
  return out;
}

}  // namespace trocar
