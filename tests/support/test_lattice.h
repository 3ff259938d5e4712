// SPDX-License-Identifier: Apache-2.0
// The lattice of most tests: 1/256 mm, the default of trocar-mesh.
#pragma once

#include "formats/mesh/lattice.h"

namespace trocar::test {

inline constexpr Lattice kLattice{8};

}  // namespace trocar::test
