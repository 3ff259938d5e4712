// SPDX-License-Identifier: Apache-2.0
// A surface for display as a Draco payload, lossless on its lattice, with a normal for each vertex.
// Internal to formats/.
// Tests: tests/formats/asset/asset_surface_test.cpp
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

/// Encodes a surface. Positions are in lattice steps. Normals are for shading only and have 8 bits.
/// Errors: (bug) check_triangle_surface() refuses the surface.
Result<std::vector<std::uint8_t>> encode_surface(const TriangleSurface& surface);

/// Decodes a payload of encode_surface() except the normals. Vertices and triangles are in Draco's
/// order. check_triangle_surface() proves what is not checked here. Errors, without a file's name:
/// (refused) corrupted bytes, other numbers of vertices or triangles, a coordinate off the lattice
/// or out of range, an index out of range.
Result<TriangleSurface> decode_surface(std::span<const std::uint8_t> bytes, std::uint64_t vertices,
                                       std::uint64_t triangles, const Lattice& lattice);

/// The node's matrix from lattice steps in the patient's frame (LPS) to glTF's metres, +Y up, by
/// columns.
std::array<double, 16> surface_matrix(const Lattice& lattice);

}  // namespace trocar
