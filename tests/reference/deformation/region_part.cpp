// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/deformation/region_part.h"

#include <algorithm>
#include <utility>

#include "formats/mesh/triangle_grid.h"
#include "runtime/haptics/membrane/region.h"

namespace trocar::runtime {

std::vector<std::uint32_t> find_seeds(const SheetMesh& sheet, const Ring& tool) {
  std::vector<std::uint32_t> seeds;
  if (tool.empty()) return seeds;
  const LatticeBox box = box_around(tool);
  for (std::uint32_t t = 0; t < sheet.triangles.size(); ++t) {
    if (sheet.in_use(t) && !apart(bounding_box(sheet, t), box)) seeds.push_back(t);
  }
  return seeds;
}

RegionPart part_within(const RegionMesh& region, const Ring& tool, const Lattice& lattice,
                       double radius_m) {
  RegionPart out;
  out.region.origin = region.origin;
  out.region.under_tool = region.under_tool;
  const auto sheet = make_sheet_mesh(region.mesh, 0, 0);
  if (!sheet) return out;  // never: the mesh is valid
  std::vector<std::uint32_t> seeds, queue;
  for (std::uint32_t t = 0; t < region.mesh.triangles.size(); ++t) {
    const Triangle& v = region.mesh.triangles[t];
    if (std::any_of(v.begin(), v.end(),
                    [&](std::uint32_t i) { return region.kind[i] == NodeKind::kTool; }))
      seeds.push_back(t);
  }
  SheetPart part =
      part_around(*sheet, seeds, circle_around(tool), radius_m / lattice.step_m(), queue);
  out.parent = std::move(part.parent);
  out.region.mesh = std::move(part.mesh);
  for (std::size_t v = 0; v < out.parent.size(); ++v) {
    NodeKind kind = region.kind[out.parent[v]];
    const LatticePoint p = out.region.mesh.vertices[v];
    const auto at = std::lower_bound(part.outer.begin(), part.outer.end(), p,
                                     [](const OuterEdge& s, LatticePoint q) { return s.from < q; });
    if (kind == NodeKind::kFree && at != part.outer.end() && at->from == p)
      kind = NodeKind::kBorder;
    out.region.kind.push_back(kind);
  }
  return out;
}

}  // namespace trocar::runtime
