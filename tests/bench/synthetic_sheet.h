// SPDX-License-Identifier: GPL-3.0-or-later
// Large synthetic sheets for cut_bench, and the same triangulations by CGAL.
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "runtime/hole_cutting/overlay.h"

namespace trocar::bench {

/// A square Delaunay sheet of about `vertices` vertices: a hexagonal grid of `spacing` steps with
/// random offsets, numbered in the order of CGAL's spatial sort. The same in every call.
SliceMesh jittered_sheet(int vertices, int spacing, std::uint64_t seed);

/// CGAL's input: points, and segments between them that do not cross.
struct CgalPslg {
  std::vector<std::array<double, 2>> points;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> segments;
};

/// The whole slice with a hole: the sheet's vertices and boundary, and the tool's outline.
CgalPslg slice_with_hole(const SliceMesh& sheet, const Ring& tool);
/// The local PSLG of a cut.
CgalPslg local_pslg(const runtime::Overlay& overlay);

/// Constrained Delaunay triangulation; the number of its faces.
std::size_t cgal_cdt(const CgalPslg& input);

}  // namespace trocar::bench
