// SPDX-License-Identifier: Apache-2.0
// The contract of a cut, which holds for every sheet and tool; shared by the tests of the cut.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <string>
#include <vector>

#include "formats/mesh/cut.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/slice_mesh.h"
#include "tests/support/motions.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {

using test::Corners;

/// A triangle by its points, the smallest first, independent of vertex numbers.
inline Corners corners_of(const SliceMesh& mesh, std::size_t t) {
  Corners c{};
  for (std::size_t i = 0; i < 3; ++i)
    c[i] = mesh.vertices[mesh.triangles[t][i]];
  std::rotate(c.begin(), std::min_element(c.begin(), c.end()), c.end());
  return c;
}

/// The ring from its smallest vertex on.
inline Ring from_smallest(Ring ring) {
  std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end()), ring.end());
  return ring;
}

/// The triangles of a mesh by their points, in order.
inline std::vector<Corners> triangles_of(const SliceMesh& mesh) {
  return test::canonical(mesh);
}

/// Empty, or the first part of the contract that the result violates.
inline std::string contract_violation(const SliceMesh& before, const CutResult& cut) {
  const SliceMesh& after = cut.mesh;
  if (auto ok = check_mesh(after); !ok) return ok.error().message;

  // Areas and counts add up exactly.
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

  // Only triangles that the cut replaced or flipped have changed, two for each flip.
  const std::vector<Corners> was = triangles_of(before), is = triangles_of(after);
  std::vector<Corners> gone;
  std::set_difference(was.begin(), was.end(), is.begin(), is.end(), std::back_inserter(gone));
  if (gone.size() > cut.triangles_removed + 2 * cut.flips)
    return "triangles have changed that the tool did not meet";

  if (is_constrained_delaunay(before) && !is_constrained_delaunay(after))
    return "the sheet is not constrained Delaunay any more";
  return {};
}

/// Empty, or why the outline of the removed material is not a valid PSLG. It is one wherever no two
/// bends of the sheet's boundary cross, see overlay.h.
inline std::string outline_violation(const CutResult& cut) {
  if (auto ok = check_pslg({cut.hole}); !ok) return "hole: " + ok.error().message;
  if (cut.doubled_area_removed < 0) return "material was added";
  return {};
}

}  // namespace trocar::runtime
