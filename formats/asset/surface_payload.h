// SPDX-License-Identifier: Apache-2.0
// A surface for display as a Draco payload, lossless on its lattice, with a normal for each vertex.
// Internal to formats/.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/triangle_surface.h"

namespace trocar {

/// Ids in the Draco payload.
inline constexpr std::uint32_t kDracoSurfacePositionId = 0, kDracoSurfaceNormalId = 1;

/// Positions are numbers of lattice steps. Normals, for shading only, have 8 bits. Fails (bug) on a
/// surface that check_triangle_surface() refuses.
Result<std::vector<std::uint8_t>> encode_surface(const TriangleSurface& surface);

/// Refused (without a file's name) if the payload is not what encode_surface() makes: corrupted,
/// not exactly this many vertices and triangles, a coordinate off the lattice or out of range, an
/// index out of range. Vertices and triangles come in Draco's order; normals are left out.
/// check_triangle_surface() proves the rest.
Result<TriangleSurface> decode_surface(std::span<const std::uint8_t> bytes, std::uint64_t vertices,
                                       std::uint64_t triangles, const Lattice& lattice);

/// Of the node: lattice steps in the patient's frame (LPS) -> glTF's metres, +Y up, by columns.
std::array<double, 16> surface_matrix(const Lattice& lattice);

}  // namespace trocar
