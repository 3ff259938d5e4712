// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/triangulation/spatial_sort.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "formats/geometry/lattice_cells.h"

namespace trocar::pipeline {
namespace {

constexpr double kVerticesPerCell = 8;

// The new number of each vertex.
std::vector<std::uint32_t> numbers_by_position(const std::vector<LatticePoint>& vertices) {
  const LatticeCells cells(box_around(vertices),
                           std::max(1.0, static_cast<double>(vertices.size()) / kVerticesPerCell));
  const auto columns = static_cast<std::size_t>(cells.columns);
  std::vector<std::uint32_t> out, first(cells.count() + 1, 0);
  out.reserve(vertices.size());
  for (const LatticePoint p : vertices) {
    const double x = static_cast<double>(p.x) - cells.low.x,
                 y = static_cast<double>(p.y) - cells.low.y;
    const std::size_t at = static_cast<std::size_t>(y / cells.size) * columns +
                           static_cast<std::size_t>(x / cells.size);
    out.push_back(static_cast<std::uint32_t>(at));
    ++first[at + 1];
  }
  std::partial_sum(first.begin(), first.end(), first.begin());
  for (std::uint32_t& v : out)
    v = first[v]++;
  return out;
}

}  // namespace

void sort_by_position(Refined& refined) {
  if (refined.mesh.vertices.empty()) return;
  const std::vector<std::uint32_t> number = numbers_by_position(refined.mesh.vertices);
  std::vector<LatticePoint> vertices(number.size());
  std::vector<VertexOrigin> origins(number.size());
  for (std::size_t v = 0; v < number.size(); ++v) {
    vertices[number[v]] = refined.mesh.vertices[v];
    origins[number[v]] = refined.origins[v];
  }
  refined.mesh.vertices = std::move(vertices);
  refined.origins = std::move(origins);
  for (Refined::Segment& s : refined.segments)
    s.from = number[s.from], s.to = number[s.to];

  std::vector<std::uint32_t> first(number.size() + 1, 0);
  for (Triangle& t : refined.mesh.triangles) {
    for (std::uint32_t& v : t)
      v = number[v];
    ++first[std::min({t[0], t[1], t[2]}) + 1];
  }
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<Triangle> triangles(refined.mesh.triangles.size());
  for (const Triangle& t : refined.mesh.triangles)
    triangles[first[std::min({t[0], t[1], t[2]})]++] = t;
  refined.mesh.triangles = std::move(triangles);
}

}  // namespace trocar::pipeline
