// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/triangulation/shared_edges.h"

#include <cstdlib>

#include "formats/geometry/edge_predicates.h"
#include "formats/geometry/segment_split.h"

namespace trocar::pipeline {

std::array<std::optional<LatticePoint>, 2> shared_split_points(LatticePoint a, LatticePoint b,
                                                               LatticePoint c, LatticePoint d,
                                                               double fraction, std::int64_t lost) {
  const std::optional<LatticePoint> here = split_near(a, b, c, fraction);
  if (here && orient2d(a, b, *here) == 0) return {here, {}};
  const std::optional<LatticePoint> there = split_near(b, a, d, 1 - fraction);
  if (!here || !there) return {here ? here : there, {}};
  if (std::abs(lost + orient2d(a, b, *there)) < std::abs(lost + orient2d(a, b, *here)))
    return {there, here};
  return {here, there};
}

bool may_split_either_way(const RefinementMesh& mesh, EdgeId edge, LatticePoint p) {
  const auto [ia, ib] = mesh.ends(edge);
  const LatticePoint a = mesh.points[ia], b = mesh.points[ib];
  if (orient2d(a, b, p) >= 0) return may_split(a, b, mesh.points[mesh.apex(edge)], p);
  return encroaches(a, b, p) && mesh.circumcircle_contains(triangle_of(edge), p);
}

}  // namespace trocar::pipeline
