// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/cut.h"

#include <algorithm>
#include <string>
#include <utility>

#include "formats/mesh_validity.h"
#include "runtime/remesh/cavity.h"
#include "runtime/remesh/overlay.h"
#include "runtime/remesh/patch.h"

namespace trocar::runtime {
namespace {

Result<void> check_tool(const Ring& tool) {
  for (LatticePoint p : tool) {
    if (p.x < -kMaxCoordinate || p.x > kMaxCoordinate || p.y < -kMaxCoordinate ||
        p.y > kMaxCoordinate) {
      return refused("tool polygon: a vertex outside the lattice's range");
    }
  }
  if (auto ok = check_pslg({{tool}}); !ok) return refused("tool polygon: " + ok.error().message);
  Ring sorted = tool;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
    return refused("tool polygon: it touches itself");
  }
  if (doubled_area(tool) <= 0) return refused("tool polygon: it does not run counter-clockwise");
  return {};
}

// What is returned is proved first; see cut.h.
Result<void> prove(const SliceMesh& sheet, const Patch& patch, const CutResult& result) {
  if (auto ok = check_mesh(result.mesh); !ok) return bug("cut: " + ok.error().message);
  if (!is_constrained_delaunay({patch.points, patch.triangles})) {
    return bug("cut: the patch is not constrained Delaunay");
  }
  std::int64_t of_hole = 0;
  for (const Ring& ring : result.hole)
    of_hole += doubled_area(ring);
  if (of_hole != result.doubled_area_removed ||
      doubled_area(sheet) - doubled_area(result.mesh) != of_hole) {
    return bug("cut: the hole's area is not what the sheet has lost");
  }
  return {};
}

}  // namespace

Result<CutResult> cut(const SliceMesh& sheet, const Ring& tool) {
  if (auto ok = check_tool(tool); !ok) return ok.error();
  const Result<Neighbours> neighbours = triangle_neighbours(sheet);
  if (!neighbours) return neighbours.error();

  // Which triangles the tool meets. Those that it only touches go as well, so
  // that no tool edge ends or lies on the edge of a triangle that stays.
  std::vector<std::uint8_t> contains(sheet.triangles.size(), 0);
  bool overlaps = false;
  for (std::uint32_t t = 0; t < sheet.triangles.size(); ++t) {
    const Contact c = contact(corners(sheet, t), tool);
    contains[t] = c != Contact::kApart;
    overlaps = overlaps || c == Contact::kOverlaps;
  }
  if (!overlaps) {
    CutResult unchanged;
    unchanged.mesh = sheet;
    return unchanged;
  }

  // Overlay and triangulate; again with a larger cavity where rounding ran into
  // a triangle that was to stay. Each round adds triangles, so this ends.
  while (true) {
    const Cavity cavity = make_cavity(sheet, *neighbours, contains);
    const Overlay local = overlay(sheet, *neighbours, cavity, tool);
    for (std::uint32_t t : local.absorb)
      contains[t] = 1;
    if (!local.absorb.empty()) continue;
    const Result<Patch> patch = make_patch(local);
    if (!patch) return patch.error();
    for (std::uint32_t t : patch->absorb)
      contains[t] = 1;
    if (!patch->absorb.empty()) continue;

    CutResult result;
    result.mesh = stitch(sheet, *neighbours, cavity, *patch);
    Result<std::vector<Ring>> hole = removed_outline(sheet, cavity, *patch);
    if (!hole) return hole.error();
    result.hole = std::move(*hole);
    for (std::uint32_t t : cavity.triangles) {
      const auto [a, b, c] = corners(sheet, t);
      result.doubled_area_removed += orient2d(a, b, c);
    }
    result.doubled_area_removed -= doubled_area(SliceMesh{patch->points, patch->triangles});
    result.triangles_removed = static_cast<std::uint32_t>(cavity.triangles.size());
    result.triangles_created = static_cast<std::uint32_t>(patch->triangles.size());
    if (auto ok = prove(sheet, *patch, result); !ok) return ok.error();
    return result;
  }
}

}  // namespace trocar::runtime
