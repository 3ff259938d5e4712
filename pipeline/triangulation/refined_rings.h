// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the boundary of a refined mesh, with one ring for each ring of the outline that was meshed.
#pragma once

#include "formats/geometry/slice_mesh.h"
#include "pipeline/triangulation/refinement.h"

namespace trocar::pipeline {

/// Returns one ring for each ring of `outline`, in the same order. `outline` is the outline that
/// was meshed to obtain `refined`. A returned ring contains the vertices of the corresponding ring
/// of `outline` and, between them, the points at which refinement split the ring's edges. Together
/// the returned rings are the boundary of the mesh. O(n log n).
Pslg refined_rings(const Refined& refined, const Pslg& outline);

}  // namespace trocar::pipeline
