// SPDX-License-Identifier: GPL-3.0-or-later
// Sorts vertices and triangles of a refined mesh by position.
#pragma once

#include "pipeline/triangulation/refinement.h"

namespace trocar::pipeline {

/// Divides the plane into the cells of a square grid, numbers the vertices cell by cell along
/// the rows of the grid, and orders the triangles by their smallest vertex number. The mesh is
/// otherwise unchanged: each triangle keeps the order of its corners. Refinement numbers
/// vertices in the order of insertion, so vertices that are neighbours in the mesh can be far
/// apart in memory. Without this sort, later stages are slow on a large mesh, because they wait
/// for memory. O(n).
void sort_by_position(Refined& refined);

}  // namespace trocar::pipeline
