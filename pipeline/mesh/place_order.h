// SPDX-License-Identifier: GPL-3.0-or-later
// Vertices and triangles of a refined mesh in the order of their place.
#pragma once

#include "pipeline/mesh/refinement.h"

namespace trocar::pipeline {

/// Numbers the vertices along the rows of a grid, from cell to cell, and the triangles by their
/// least vertex. The same mesh: its corners keep their order within each triangle. Refinement
/// numbers points as it inserts them; in a large mesh, whatever walks over the triangles then waits
/// for memory. O(n).
void order_by_place(Refined& refined);

}  // namespace trocar::pipeline
