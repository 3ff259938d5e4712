// SPDX-License-Identifier: GPL-3.0-or-later
// A slice's outline in the format of Shewchuk's program Triangle (.poly).
#pragma once

#include <string>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// The contents of the file: the outline's vertices and segments in mm in the slice plane, and a
/// point inside each hole, by which Triangle recognises the hole. To find these points, the
/// function triangulates the holes. Errors: those of triangulate().
Result<std::string> poly_text(const AssetSlice& slice, const Lattice& lattice);

}  // namespace trocar::pipeline
