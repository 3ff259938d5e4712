// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/triangle_surface.h"

#include <Eigen/Geometry>

namespace trocar {
namespace {

using Vector3i64 = Eigen::Matrix<std::int64_t, 3, 1>;

Vector3i64 difference(const SpacePoint& a, const SpacePoint& b) {
  return {std::int64_t{a[0]} - b[0], std::int64_t{a[1]} - b[1], std::int64_t{a[2]} - b[2]};
}

// The triangle's normal, with twice the area as its length.
Vector3i64 doubled_normal(const TriangleSurface& s, const std::array<std::uint32_t, 3>& t) {
  return difference(s.vertices[t[1]], s.vertices[t[0]])
      .cross(difference(s.vertices[t[2]], s.vertices[t[0]]));
}

std::string name(const char* what, std::size_t i) {
  return std::string(what) + " " + std::to_string(i);
}

Result<void> check_simplices(const TriangleSurface& surface) {
  for (std::size_t i = 0; i < surface.vertices.size(); ++i) {
    for (const std::int32_t c : surface.vertices[i])
      if (c < -kMaxSpaceCoordinate || c > kMaxSpaceCoordinate)
        return refused(name("vertex", i) + " of the surface is outside the lattice's range");
  }
  std::vector<bool> used(surface.vertices.size(), false);
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
    for (const std::uint32_t v : surface.triangles[i]) {
      if (v >= surface.vertices.size())
        return refused(name("triangle", i) + " of the surface has no such vertex");
      used[v] = true;
    }
    if (doubled_normal(surface, surface.triangles[i]).isZero())
      return refused(name("triangle", i) + " of the surface has no area");
  }
  const auto unused = std::find(used.begin(), used.end(), false);
  if (unused != used.end())
    return refused(name("vertex", static_cast<std::size_t>(unused - used.begin())) +
                   " of the surface is in no triangle");
  return {};
}

}  // namespace

std::pair<SpacePoint, SpacePoint> box_around(const std::vector<SpacePoint>& points) {
  SpacePoint low = points[0], high = low;
  for (const SpacePoint& p : points) {
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], p[k]);
      high[k] = std::max(high[k], p[k]);
    }
  }
  return {low, high};
}

Result<void> check_triangle_surface(const TriangleSurface& surface) {
  if (surface.triangles.empty()) return refused("the surface has no triangles");
  if (auto ok = check_simplices(surface); !ok) return ok;

  // The triangles at a vertex, as directed edges of its link: (vertex, from, to).
  std::vector<std::array<std::uint32_t, 3>> links;
  links.reserve(3 * surface.triangles.size());
  for (const auto& t : surface.triangles)
    for (std::size_t k = 0; k < 3; ++k)
      links.push_back({t[k], t[(k + 1) % 3], t[(k + 2) % 3]});
  std::sort(links.begin(), links.end());
  for (std::size_t begin = 0, end = 0; begin < links.size(); begin = end) {
    const std::uint32_t vertex = links[begin][0];
    while (end < links.size() && links[end][0] == vertex)
      ++end;
    const auto first = links.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto last = links.begin() + static_cast<std::ptrdiff_t>(end);
    // Each edge from the vertex starts one link edge. A walk along the link edges must visit all.
    for (auto at = first; at + 1 != last; ++at)
      if ((*at)[1] == (*(at + 1))[1])
        return refused(name("vertex", vertex) + " of the surface: two triangles pass its edge to " +
                       name("vertex", (*at)[1]) + " in the same direction");
    auto at = first;
    std::size_t met = 0;
    do {
      const std::uint32_t to = (*at)[2];
      const auto next = std::lower_bound(
          first, last, to, [](const auto& link, std::uint32_t v) { return link[1] < v; });
      if (next == last || (*next)[1] != to)
        return refused(name("vertex", vertex) + " of the surface: its edge to " +
                       name("vertex", to) + " has one triangle only: it is not closed");
      at = next;
      ++met;
    } while (at != first && met <= end - begin);
    if (at != first || met != end - begin)
      return refused(name("vertex", vertex) +
                     " of the surface: its triangles are more than one fan");
  }
  if (!(enclosed_volume(surface) > 0)) return refused("the surface is inside out");
  return {};
}

std::vector<Eigen::Vector3f> vertex_normals(const TriangleSurface& surface) {
  std::vector<Eigen::Vector3d> sum(surface.vertices.size(), Eigen::Vector3d::Zero());
  for (const auto& t : surface.triangles) {
    const Eigen::Vector3d normal = doubled_normal(surface, t).cast<double>().normalized();
    for (std::size_t k = 0; k < 3; ++k) {
      const SpacePoint& p = surface.vertices[t[k]];
      const Eigen::Vector3d a =
          difference(surface.vertices[t[(k + 1) % 3]], p).cast<double>().normalized();
      const Eigen::Vector3d b =
          difference(surface.vertices[t[(k + 2) % 3]], p).cast<double>().normalized();
      sum[t[k]] += std::acos(std::clamp(a.dot(b), -1.0, 1.0)) * normal;
    }
  }
  std::vector<Eigen::Vector3f> out;
  out.reserve(sum.size());
  for (const Eigen::Vector3d& n : sum) {
    const double length = n.norm();
    const Eigen::Vector3d unit =
        length > 1e-9 ? Eigen::Vector3d(n / length) : Eigen::Vector3d(Eigen::Vector3d::UnitZ());
    out.emplace_back(unit.cast<float>());
  }
  return out;
}

double enclosed_volume(const TriangleSurface& surface) {
  if (surface.vertices.empty()) return 0;
  const SpacePoint& origin = surface.vertices[0];
  double sum = 0;
  for (const auto& t : surface.triangles)
    sum += difference(surface.vertices[t[0]], origin)
               .cast<double>()
               .dot(doubled_normal(surface, t).cast<double>());
  return sum / 6;
}

}  // namespace trocar
