// SPDX-License-Identifier: Apache-2.0
// Encodes a surface for display as a Draco payload, and decodes it. The payload keeps the lattice
// coordinates exactly and has a normal for each vertex. Internal to formats/.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/triangle_surface.h"

namespace trocar {

/// Ids of the attributes in the Draco payload.
inline constexpr std::uint32_t kDracoSurfacePositionId = 0, kDracoSurfaceNormalId = 1;

/// Encodes a surface. Positions are stored in lattice steps. Normals are for shading only and are
/// quantised to 8 bits. Errors: kBug if check_triangle_surface() refuses the surface; kRefused if
/// the surface extends over more than 2^24 - 1 lattice steps.
Result<std::vector<std::uint8_t>> encode_surface(const TriangleSurface& surface);

/// Decodes a payload of encode_surface(), but not its normals. Vertices and triangles are in
/// Draco's order. Whether the surface is valid is not checked: call check_triangle_surface().
/// Errors: kRefused if the bytes are corrupted, if bytes follow the mesh, if the payload does not
/// have `vertices` vertices and `triangles` triangles (the numbers in the file's JSON), if a
/// coordinate is off the lattice or out of range, or if an index is out of range. Messages do not contain the file's name.
Result<TriangleSurface> decode_surface(std::span<const std::uint8_t> bytes, std::uint64_t vertices,
                                       std::uint64_t triangles, const Lattice& lattice);

/// The matrix of a surface's node, column by column. It maps lattice steps in the patient's frame
/// (LPS) to glTF's frame (metres, +Y up).
std::array<double, 16> surface_matrix(const Lattice& lattice);

}  // namespace trocar
