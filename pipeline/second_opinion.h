// SPDX-License-Identifier: GPL-3.0-or-later
// A second opinion on an asset: what formats/geometry/mesh_validity.h proves by our code, confirmed
// by CGAL's exact predicates and its constrained Delaunay triangulation. Shares no code with our
// proofs.
#pragma once

#include <string>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// Confirms of every slice, or names the slice and the first thing that differs:
///  - every ring of the outline is a simple polygon, and no two edges of it cross or overlap;
///  - a triangulation of the outline by CGAL, with the mesh's vertices, covers the same area with
///  the
///    same number of triangles;
///  - the mesh's triangles are counter-clockwise, meet edge to edge, end at the outline only and
///  use
///    every vertex;
///  - they are CGAL's triangles, or differ from them only where four and more vertices lie on one
///    circle, so that there are several constrained Delaunay triangulations.
/// Of the materials of a slice: their outlines neither cross nor overlap, and every region between
/// them belongs to one material or to none, whichever of its edges is asked.
/// A surface for display has no self-intersection (surface_proof.h); that it is closed and manifold
/// verify_asset() has proved before.
/// Coordinates are integers of the lattice, so nothing is rounded. Errors (refused).
/// O(n log n) for most slices.
Result<void> confirm_by_cgal(const Asset& asset, const std::string& name);

}  // namespace trocar::pipeline
