// SPDX-License-Identifier: GPL-3.0-or-later
// A network of borders as refinement left it.
#pragma once

#include <span>

#include "formats/geometry/slice_mesh.h"
#include "pipeline/contour/label_network.h"

namespace trocar::pipeline {

/// The network with the points that refinement put on its edges. `outlines` are the network's
/// material_outlines(), `stored` the same refined: ring by ring from the same vertex, as
/// check_shared_borders() (formats/geometry/shared_borders.h) proves. O(n log n).
LabelNetwork refined_network(const LabelNetwork& network, std::span<const Pslg> outlines,
                             std::span<const Pslg> stored);

}  // namespace trocar::pipeline
