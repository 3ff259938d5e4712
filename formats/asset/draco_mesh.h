// SPDX-License-Identifier: Apache-2.0
// A slice mesh, and the HU at its vertices, as a Draco (Edgebreaker) payload. The payload is
// lossless for coordinates on the lattice and for HU that are multiples of kHuStep.
//
// Positions are stored in lattice steps. Draco quantises positions to whole multiples of a quantum:
// it divides a range into 2^quantization_bits - 1 quanta. encode_draco() gives Draco a range of
// this number of lattice steps, so the quantum is one step. Draco computes q = x - origin when it
// encodes, and x = q + origin when it decodes. This float arithmetic is exact as long as all
// numbers fit into a float's 24 bits. All vertices have the same z. The payload stores this z as
// the third coordinate of the origin. HU are stored as integers (unit kHuStep), with no quantum.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

/// The quantisation grid, the same for all slices of a scan.
struct DracoGrid {
  Lattice lattice;
  LatticePoint origin;        ///< lower bound of all coordinates of the scan
  int quantization_bits = 1;  ///< at most 24; 2^bits - 1 steps is at least the scan's extent
  bool colours = false;       ///< if true, HU at vertices are stored also as colours
};

inline constexpr const char* kDracoExtension = "KHR_draco_mesh_compression";
/// Draco id of the attribute for positions in every payload of an asset.
inline constexpr std::uint32_t kDracoPositionId = 0;
/// Draco id of the attribute for HU at vertices, if there are any. The attribute is a GENERIC int16
/// scalar, whose unit is kHuStep HU.
inline constexpr std::uint32_t kDracoHuId = 1;
inline constexpr const char* kHuAttribute = "_HU";  ///< name of the HU attribute in glTF
/// HU at vertices are multiples of kHuStep from kMinHu to kMaxHu. This range is wider than that of
/// voxels, because HU at vertices are fitted to the voxels and may lie beyond the voxels' values.
inline constexpr int kMinHu = -8192, kMaxHu = 24568, kHuStep = 8;
/// The multiple of kHuStep from kMinHu to kMaxHu nearest to `hu`. Precondition: `hu` is finite.
float stored_hu(float hu);

/// Draco id of the attribute for vertex colours, which are stored on request for viewers. The
/// attribute is a COLOR of three bytes. The bytes 0 to 255 mean 0 to 1 in linear light (without
/// gamma correction).
inline constexpr std::uint32_t kDracoColourId = 2;
inline constexpr const char* kColourAttribute = "COLOR_0";  ///< name of the colours in glTF
using HuColour = std::array<std::uint8_t, 3>;               ///< red, green, blue
/// The colour of a stored HU: the colour map viridis from -200 to 1848 HU (table in asset.md). HU
/// outside this range get the first or the last colour.
HuColour hu_colour(float hu);

/// Encodes a mesh at z = 0, with one HU for each vertex or with none. Errors: kBug if the mesh is
/// empty or outside the grid, if a HU is not finite, or if the number of HU is wrong.
Result<std::vector<std::uint8_t>> encode_draco(const SliceMesh& mesh, const DracoGrid& grid,
                                               std::span<const float> hu = {});
/// A payload of encode_draco() has one float that is the z of all vertices. Returns the offset of
/// this float. Errors: kBug if the payload does not end with the origin and the range of `grid`.
Result<std::size_t> draco_z_at(std::span<const std::uint8_t> payload, const DracoGrid& grid);

/// The contents of a payload.
struct DracoSlice {
  SliceMesh mesh;
  std::vector<float> hu;  ///< empty if the payload has none
  std::int32_t z = 0;     ///< height of all vertices, steps
  bool has_colours = false;
};
/// Decodes a payload of encode_draco(). Vertices and triangles are in Draco's order. Errors: those of check_draco_counts(),
/// which is called before Draco allocates memory; kRefused if bytes are corrupted, a coordinate is
/// off the lattice, vertices differ in z, an index or a HU is out of range, or colours do not match
/// the HU. Messages do not contain the file's name.
Result<DracoSlice> decode_draco(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles);

/// Checks the numbers of vertices and triangles in a payload's header, because Draco allocates
/// memory for these numbers before it reads further. Errors: kRefused if the header is not that of
/// an Edgebreaker mesh, or if the header states more than `max_vertices` vertices or more than
/// `max_triangles` triangles, or more than max_triangles_in() of the payload's size.
Result<void> check_draco_counts(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles);

/// The largest number of triangles for which memory is allocated on the word of this many bytes: 64
/// for each byte, and at least 2^22.
std::uint64_t max_triangles_in(std::uint64_t bytes);

}  // namespace trocar
