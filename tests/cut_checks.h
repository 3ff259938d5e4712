// SPDX-License-Identifier: Apache-2.0
// What must hold of every cut, whatever the sheet and the tool: shared by the
// tests of the cut.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "formats/mesh_validity.h"
#include "formats/slice_mesh.h"
#include "runtime/remesh/cut.h"

namespace trocar::runtime {

using Corners = std::array<LatticePoint, 3>;

/// A triangle by its points, the smallest first, so that vertex numbers do not count.
inline Corners corners_of(const SliceMesh& mesh, std::size_t t) {
  Corners c{};
  for (std::size_t i = 0; i < 3; ++i)
    c[i] = mesh.vertices[mesh.triangles[t][i]];
  std::rotate(c.begin(), std::min_element(c.begin(), c.end()), c.end());
  return c;
}

/// The ring turned so that it starts at its smallest vertex.
inline Ring from_smallest(Ring ring) {
  std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end()), ring.end());
  return ring;
}

/// Empty, or the first law that the result breaks.
inline std::string broken_law(const SliceMesh& before, const CutResult& cut) {
  const SliceMesh& after = cut.mesh;
  if (auto ok = check_mesh(after); !ok) return ok.error().message;

  // The books balance, exactly.
  const std::int64_t lost = doubled_area(before) - doubled_area(after);
  if (lost != cut.doubled_area_removed) return "doubled_area_removed is not the area lost";
  std::int64_t of_hole = 0;
  for (const Ring& ring : cut.hole)
    of_hole += doubled_area(ring);
  if (of_hole != lost) return "the hole's area is not the area lost";
  if (before.triangles.size() + cut.triangles_created !=
      after.triangles.size() + cut.triangles_removed) {
    return "triangle counts do not add up";
  }

  // Triangles that the tool did not meet are as they were, in their order.
  const std::size_t kept = before.triangles.size() - cut.triangles_removed;
  std::size_t b = 0;
  for (std::size_t t = 0; t < kept; ++t, ++b) {
    while (b < before.triangles.size() && corners_of(before, b) != corners_of(after, t))
      ++b;
    if (b == before.triangles.size()) return "a triangle that stays has changed";
  }

  // The new ones are constrained Delaunay among themselves.
  SliceMesh patch{
      after.vertices,
      {after.triangles.begin() + static_cast<std::ptrdiff_t>(kept), after.triangles.end()}};
  if (!is_constrained_delaunay(patch)) return "the patch is not constrained Delaunay";
  return {};
}

/// Is the outline of what went made of proper rings? Holds wherever no two
/// bends of the sheet's boundary cross, see overlay.h.
inline std::string broken_outline(const CutResult& cut) {
  if (auto ok = check_pslg({cut.hole}); !ok) return "hole: " + ok.error().message;
  if (cut.doubled_area_removed < 0) return "material was added";
  return {};
}

}  // namespace trocar::runtime
