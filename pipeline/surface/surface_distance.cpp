// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/surface/surface_distance.h"

#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>

#if __has_include(<CGAL/AABB_traits_3.h>)  // since CGAL 6
#include <CGAL/AABB_traits_3.h>
#else
#include <CGAL/AABB_traits.h>
#endif

namespace trocar::pipeline {
namespace {

using Eigen::Vector3d;

constexpr std::size_t kSamples = 20'000;

// Positions of the vertices in the volume's frame.
std::vector<Vector3d> positions(const TriangleSurface& surface, const SurfaceVolume& volume) {
  const Eigen::Affine3d T_volume_lps = volume.T_lps_volume.inverse();
  const Lattice& lattice = surface.lattice;
  std::vector<Vector3d> out;
  out.reserve(surface.vertices.size());
  for (const SpacePoint& p : surface.vertices)
    out.emplace_back(T_volume_lps *
                     Vector3d(lattice.to_mm(p[0]), lattice.to_mm(p[1]), lattice.to_mm(p[2])));
  return out;
}

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Primitive = CGAL::AABB_face_graph_triangle_primitive<Mesh>;
#if __has_include(<CGAL/AABB_traits_3.h>)
using Traits = CGAL::AABB_traits_3<Kernel, Primitive>;
#else
using Traits = CGAL::AABB_traits<Kernel, Primitive>;
#endif

// The distance to the nearest point of the zero level on 26 rays and on some along the gradient.
double distance_to_zero(const SurfaceVolume& volume, const Vector3d& p) {
  const auto [u, v, w] = volume.voxel_mm();
  const double step = std::min({u, v, w}) / 8;
  const bool inside = volume.at(p) >= 0;
  double best = std::numeric_limits<double>::infinity();
  Vector3d nearest = p;
  const auto along = [&](const Vector3d& direction, double length) {
    for (int k = 1; k * step < std::min(best, length) + step; ++k) {
      const double t = k * step;
      if ((volume.at(p + t * direction) >= 0) == inside) continue;
      double low = t - step, high = t;
      for (int i = 0; i < 12; ++i) {
        const double middle = (low + high) / 2;
        ((volume.at(p + middle * direction) >= 0) == inside ? low : high) = middle;
      }
      if (high < best) {
        best = high;
        nearest = p + high * direction;
      }
      return;
    }
  };
  const Vector3d up = volume.gradient(p, step);
  double length = 32 * step;
  for (int doubling = 0; doubling < 6 && !std::isfinite(best); ++doubling, length *= 4) {
    along(inside ? Vector3d(-up) : up, length);
    for (int k = 0; k < 27; ++k)
      if (k != 13)
        along(Eigen::Vector3i(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1).cast<double>().normalized(),
              length);
  }
  for (int i = 0; i < 3 && std::isfinite(best); ++i) {
    const Vector3d g = volume.gradient(nearest, step);
    along(inside ? Vector3d(-g) : g, length);
  }
  return best;
}

// Points spread evenly over the triangles.
std::vector<Vector3d> points_on(const std::vector<Vector3d>& vertices,
                                const TriangleSurface& surface) {
  double area = 0;
  const auto area_of = [&](const std::array<std::uint32_t, 3>& t) {
    const Vector3d& p = vertices[t[0]];
    return (vertices[t[1]] - p).cross(vertices[t[2]] - p).norm() / 2;
  };
  for (const auto& t : surface.triangles)
    area += area_of(t);
  const double each = area / static_cast<double>(kSamples);
  std::vector<Vector3d> out;
  double passed = 0;
  for (const auto& t : surface.triangles) {
    passed += area_of(t);
    while (passed > (static_cast<double>(out.size()) + 0.5) * each && out.size() < kSamples) {
      // The R2 sequence (Roberts 2018), folded into the triangle.
      const auto n = static_cast<double>(out.size());
      double a = n * 0.7548776662466927, b = n * 0.5698402909980532;
      a -= std::floor(a);
      b -= std::floor(b);
      if (a + b > 1) {
        a = 1 - a;
        b = 1 - b;
      }
      out.emplace_back((1 - a - b) * vertices[t[0]] + a * vertices[t[1]] + b * vertices[t[2]]);
    }
  }
  return out;
}

// Precondition: there are values.
double percentile(std::vector<double>& values, double share) {
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

SurfaceDistance summary(std::vector<double> values) {
  if (values.empty()) return {};
  return {percentile(values, 0.5), percentile(values, 0.99), percentile(values, 1)};
}

}  // namespace

SurfaceDistance distance_from(const TriangleSurface& surface, const SurfaceVolume& volume) {
  std::vector<double> distances;
  for (const Vector3d& p : points_on(positions(surface, volume), surface))
    distances.push_back(distance_to_zero(volume, p));
  return summary(std::move(distances));
}

SurfaceDistance distance_to(const TriangleSurface& surface, const SurfaceVolume& volume,
                            const std::vector<Vector3d>& points) {
  if (surface.triangles.empty()) return {};
  Mesh mesh;
  for (const Vector3d& p : positions(surface, volume))
    mesh.add_vertex({p.x(), p.y(), p.z()});
  for (const auto& t : surface.triangles)
    mesh.add_face(Mesh::Vertex_index(t[0]), Mesh::Vertex_index(t[1]), Mesh::Vertex_index(t[2]));
  CGAL::AABB_tree<Traits> tree;
  tree.insert(faces(mesh).first, faces(mesh).second, mesh);
  tree.accelerate_distance_queries();
  std::vector<double> distances;
  distances.reserve(points.size());
  for (const Vector3d& p : points)
    distances.push_back(std::sqrt(tree.squared_distance({p.x(), p.y(), p.z()})));
  return summary(std::move(distances));
}

std::vector<Vector3d> points_on_zero(const SurfaceVolume& volume) {
  const auto row = static_cast<std::size_t>(volume.size[0]);
  const std::array<std::size_t, 3> next{1, row, row * volume.size[1]};
  // Every `stride`-th edge that is met, by the voxel at its end and the one at its beginning. The
  // border is outside, so no edge leads from a row's end to the next row.
  std::vector<std::pair<std::size_t, std::size_t>> edges;
  std::size_t stride = 1, met = 0;
  for (std::size_t i = next[2]; i < volume.values.size(); ++i) {
    const bool inside = volume.values[i] >= 0;
    for (const std::size_t step : next) {
      if ((volume.values[i - step] >= 0) == inside || met++ % stride != 0) continue;
      edges.emplace_back(i, i - step);
      if (edges.size() < 2 * kSamples) continue;
      for (std::size_t k = 0; k < kSamples; ++k)
        edges[k] = edges[2 * k];
      edges.resize(kSamples);
      stride *= 2;
    }
  }
  std::vector<Vector3d> out;
  for (const auto& [i, j] : edges) {
    const auto a = static_cast<double>(volume.values[i]), b = static_cast<double>(volume.values[j]);
    out.emplace_back(volume.position(i) + a / (a - b) * (volume.position(j) - volume.position(i)));
  }
  return out;
}

}  // namespace trocar::pipeline
