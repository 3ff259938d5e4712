// SPDX-License-Identifier: GPL-3.0-or-later
// The outline as a refined mesh contains it, with one ring for each ring of the outline
// that was meshed.
// Tests: tests/pipeline/triangulation/regions_test.cpp
#pragma once

#include "formats/geometry/slice_mesh.h"
#include "pipeline/triangulation/refinement.h"

namespace trocar::pipeline {

/// Returns one ring for each ring of `outline`, in the same order. `outline` is the outline that
/// was meshed to obtain `refined`. A returned ring consists of the vertices of its ring of
/// `outline` and, between them, the points by which refinement split the edges. Together the
/// returned rings are the boundary of the mesh. O(n log n).
Pslg refined_rings(const Refined& refined, const Pslg& outline);

}  // namespace trocar::pipeline
