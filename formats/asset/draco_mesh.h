// SPDX-License-Identifier: Apache-2.0
// A slice mesh as a Draco (Edgebreaker) payload, lossless on the lattice.
//
// With range = (2^bits - 1) * step and step a power of two, Draco's float arithmetic is exact:
// q = (x - origin) / step when encoding, x = q * step + origin when decoding, as long as all
// numbers of steps fit a float's 24 bits.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

/// The quantisation grid, the same for all slices of a scan.
struct DracoGrid {
  Lattice lattice;
  LatticePoint origin;        ///< at or below all coordinates of the scan
  int quantization_bits = 1;  ///< 2^bits - 1 >= largest extent; at most 24
};

inline constexpr const char* kDracoExtension = "KHR_draco_mesh_compression";
/// In an asset every Draco payload holds one attribute, the position, under this id.
inline constexpr std::uint32_t kDracoPositionId = 0;

/// Fails (bug) on an empty mesh or one outside the grid.
Result<std::vector<std::uint8_t>> encode_draco(const SliceMesh& mesh, const DracoGrid& grid);

/// Refused (without a file's name) if the payload is not what encode_draco makes: corrupted, more
/// than `max_vertices` or `max_triangles`, more triangles than 2^22 and than 64 a byte, a
/// coordinate off the lattice, an index out of range. Its counts are checked before Draco allocates
/// for them. Vertices and triangles come in Draco's order.
Result<SliceMesh> decode_draco(std::span<const std::uint8_t> bytes, const Lattice& lattice,
                               std::uint64_t max_vertices, std::uint64_t max_triangles);

/// Refused if the payload's header is not an Edgebreaker mesh's, or states more than these numbers
/// or than its bytes can hold: Draco allocates for them before it reads on.
Result<void> check_draco_counts(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles);

}  // namespace trocar
