// SPDX-License-Identifier: Apache-2.0
// Compares sheet meshes to the last slot.
#pragma once

#include "formats/mesh/sheet_mesh.h"

namespace trocar::test {

/// True if the meshes are equal, including their free slots and the order of all slots.
inline bool same(const trocar::SheetMesh& a, const trocar::SheetMesh& b) {
  return a.vertices == b.vertices && a.triangles == b.triangles && a.across == b.across &&
         a.free_vertices == b.free_vertices && a.free_triangles == b.free_triangles;
}

}  // namespace trocar::test
