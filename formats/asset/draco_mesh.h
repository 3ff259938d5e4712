// SPDX-License-Identifier: Apache-2.0
// A slice mesh, and the HU at its vertices, as a Draco (Edgebreaker) payload, lossless on the
// lattice and on the HU step.
//
// Positions are numbers of lattice steps. With a range of 2^bits - 1, Draco's float arithmetic is
// exact: q = x - origin when encoding, x = q + origin when decoding, as long as all numbers fit a
// float's 24 bits. All vertices have the same z, that of the origin. HU are whole numbers of
// kHuStep; integers need no quantisation.
#pragma once

#include <array>
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
  bool colours = false;       ///< also store the HU, where they are known, as colours
};

inline constexpr const char* kDracoExtension = "KHR_draco_mesh_compression";
/// In an asset every Draco payload holds the position under this id.
inline constexpr std::uint32_t kDracoPositionId = 0;
/// Where HU are known there is a second one, a GENERIC int16 scalar, in steps of kHuStep.
inline constexpr std::uint32_t kDracoHuId = 1;
inline constexpr const char* kHuAttribute = "_HU";  ///< its name in glTF
/// HU are stored as n * kHuStep, from kHuLow to kHuHigh. A least-squares fit goes beyond the range
/// of its voxels.
inline constexpr int kHuLow = -8192, kHuHigh = 24568, kHuStep = 8;
/// The nearest HU that is stored. `hu` is finite.
float stored_hu(float hu);

/// For viewers, on request: a COLOR beside the HU, three normalised u8 in linear light.
inline constexpr std::uint32_t kDracoColourId = 2;
inline constexpr const char* kColourAttribute = "COLOR_0";  ///< its name in glTF
using HuColour = std::array<std::uint8_t, 3>;               ///< red, green, blue
/// The colour of a stored HU: viridis from -200 to 1848 HU (table: asset.md), bounded beyond.
HuColour hu_colour(float hu);

/// Fails (bug) on an empty mesh, one outside the grid, and HU that are not finite or not one for
/// each vertex; no HU at all are left out. z is 0.
Result<std::vector<std::uint8_t>> encode_draco(const SliceMesh& mesh, const DracoGrid& grid,
                                               std::span<const float> hu = {});
/// Where in a payload that encode_draco() made the float is that is the z of all vertices.
Result<std::size_t> draco_z_at(std::span<const std::uint8_t> payload, const DracoGrid& grid);

struct DracoSlice {
  SliceMesh mesh;
  std::vector<float> hu;  ///< empty if the payload has none
  std::int32_t z = 0;     ///< of all vertices, in steps
  bool has_colours = false;
};
/// Refused (without a file's name) if the payload is not what encode_draco makes: corrupted, more
/// than `max_vertices` or `max_triangles`, more triangles than 2^22 and than 64 a byte, a
/// coordinate off the lattice, an index out of range, HU that are not stored_hu(), colours that are
/// not theirs. Its counts are checked before Draco allocates for them. Vertices and triangles come
/// in Draco's order. Coordinates are numbers of 2^-`bits` mm: 0 where they are stored in steps,
/// lattice.bits where in mm (schema 1).
Result<DracoSlice> decode_draco(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles, int bits = 0);

/// Refused if the payload's header is not an Edgebreaker mesh's, or states more than these numbers
/// or than its bytes can hold: Draco allocates for them before it reads on.
Result<void> check_draco_counts(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles);

}  // namespace trocar
