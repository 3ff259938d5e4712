// SPDX-License-Identifier: GPL-3.0-or-later
// Large sheets made up for cut_bench, and CGAL's way to the same triangulations.
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "runtime/cut/overlay.h"

namespace trocar::bench {

/// A square sheet of about `vertices` vertices, jittered off a hexagonal grid of `spacing` steps,
/// Delaunay; numbered as CGAL's spatial sort leaves them. The same every time.
SliceMesh jittered_sheet(int vertices, int spacing, std::uint64_t seed);

/// What CGAL is given to build: points, and segments between them that do not cross.
struct CgalPslg {
  std::vector<std::array<double, 2>> points;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> segments;
};

/// The whole slice with a hole: the sheet's vertices and boundary, and the tool's outline.
CgalPslg slice_with_hole(const SliceMesh& sheet, const Ring& tool);
/// A cut's own local PSLG.
CgalPslg local_pslg(const runtime::Overlay& overlay);

/// Constrained Delaunay triangulation; the number of its faces.
std::size_t cgal_cdt(const CgalPslg& input);

}  // namespace trocar::bench
