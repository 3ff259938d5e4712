// SPDX-License-Identifier: Apache-2.0
// A slice mesh, and the HU at its vertices, as a Draco (Edgebreaker) payload, lossless on the
// lattice and on the HU step.
//
// Positions are numbers of lattice steps. With a range of 2^bits - 1, Draco's float arithmetic is
// exact as long as all numbers fit into a float's 24 bits: q = x - origin when encoding, and x = q
// + origin when decoding. All vertices have the same z, that of the origin. HU are whole multiples
// of kHuStep; integers need no quantisation.
// Tests: tests/formats/asset/asset_test.cpp
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
  LatticePoint origin;        ///< lower bound of all coordinates of the scan
  int quantization_bits = 1;  ///< 2^bits - 1 >= largest extent; at most 24
  bool colours = false;       ///< also store the HU, where they are known, as colours
};

inline constexpr const char* kDracoExtension = "KHR_draco_mesh_compression";
/// Draco id of the position in every payload of an asset.
inline constexpr std::uint32_t kDracoPositionId = 0;
/// Draco id of the HU, if they are known: a GENERIC int16 scalar in steps of kHuStep.
inline constexpr std::uint32_t kDracoHuId = 1;
inline constexpr const char* kHuAttribute = "_HU";  ///< its attribute name in glTF
/// HU are stored as n * kHuStep, from kMinHu to kMaxHu. The range is wider than that of voxels
/// because a least-squares fit may exceed it.
inline constexpr int kMinHu = -8192, kMaxHu = 24568, kHuStep = 8;
/// The nearest HU that is stored. `hu` is finite.
float stored_hu(float hu);

/// Draco id of the vertex colours for viewers, on request: a COLOR of three normalised u8 in linear
/// light.
inline constexpr std::uint32_t kDracoColourId = 2;
inline constexpr const char* kColourAttribute = "COLOR_0";  ///< its name in glTF
using HuColour = std::array<std::uint8_t, 3>;               ///< red, green, blue
/// The colour of a stored HU: viridis from -200 to 1848 HU (table in asset.md), clamped outside.
HuColour hu_colour(float hu);

/// Encodes a mesh at z = 0, with one HU for each vertex or with none. Errors: (bug) the mesh is
/// empty or outside the grid, HU are not finite or their number is wrong.
Result<std::vector<std::uint8_t>> encode_draco(const SliceMesh& mesh, const DracoGrid& grid,
                                               std::span<const float> hu = {});
/// The offset, in a payload of encode_draco(), of the float that is the z of all vertices.
Result<std::size_t> draco_z_at(std::span<const std::uint8_t> payload, const DracoGrid& grid);

struct DracoSlice {
  SliceMesh mesh;
  std::vector<float> hu;  ///< empty if the payload has none
  std::int32_t z = 0;     ///< height of all vertices, steps
  bool has_colours = false;
};
/// Decodes a payload of encode_draco(). Vertices and triangles are in Draco's order. The unit of
/// the stored coordinates is 2^-`bits` lattice steps. `bits` is 0 in schema 2, which stores steps,
/// and lattice.bits in schema 1, which stores mm. Counts are checked before Draco allocates for
/// them. Errors, without a file's name: (refused) corrupted bytes; more than `max_vertices` or
/// `max_triangles`; more than both 2^22 triangles and 64 for each byte; a coordinate off the
/// lattice; an index out of range; HU that are not stored_hu(); colours that do not match the HU.
Result<DracoSlice> decode_draco(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles, int bits = 0);

/// Checks the counts for which Draco allocates memory before it reads further. Errors: (refused)
/// the payload's header is not that of an Edgebreaker mesh, or states more than these numbers or
/// more than its bytes can hold.
Result<void> check_draco_counts(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles);

}  // namespace trocar
