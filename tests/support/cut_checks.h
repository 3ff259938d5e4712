// SPDX-License-Identifier: Apache-2.0
// What must hold of every cut, whatever the sheet and the tool: shared by the
// tests of the cut.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <string>
#include <vector>

#include "formats/geometry/mesh_validity.h"
#include "formats/geometry/slice_mesh.h"
#include "runtime/cut/cut.h"

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

/// The triangles of a mesh by their points, in order.
inline std::vector<Corners> triangles_of(const SliceMesh& mesh) {
  std::vector<Corners> all;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    all.push_back(corners_of(mesh, t));
  std::sort(all.begin(), all.end());
  return all;
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

  // Of the triangles, those alone have changed that the cut replaced or flipped, two a flip.
  const std::vector<Corners> was = triangles_of(before), is = triangles_of(after);
  std::vector<Corners> gone;
  std::set_difference(was.begin(), was.end(), is.begin(), is.end(), std::back_inserter(gone));
  if (gone.size() > cut.triangles_removed + 2 * cut.flips)
    return "triangles have changed that the tool did not meet";

  if (is_constrained_delaunay(before) && !is_constrained_delaunay(after))
    return "the sheet is not constrained Delaunay any more";
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
