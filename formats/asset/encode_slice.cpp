// SPDX-License-Identifier: Apache-2.0
// Encodes one slice, independently of all others.
// Tests: tests/formats/asset/asset_test.cpp
#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/asset/draco_mesh.h"
#include "formats/asset/slice_payload.h"
#include "formats/geometry/mesh_validity.h"

namespace trocar {

Result<DracoGrid> asset_grid(const Lattice& lattice, const LatticeBox& box) {
  const auto [low, high] = box;
  const std::int64_t max_coordinate =
      std::max({std::abs(std::int64_t{low.x}), std::abs(std::int64_t{low.y}),
                std::abs(std::int64_t{high.x}), std::abs(std::int64_t{high.y})});
  DracoGrid grid{lattice, low, 1};
  const std::int64_t span =
      std::max(std::int64_t{high.x} - grid.origin.x, std::int64_t{high.y} - grid.origin.y);
  if (span > kMaxAssetSpan || max_coordinate > kMaxAssetExtent) {
    return refused("the slices span " + std::to_string(std::max(span, max_coordinate)) +
                   " lattice steps; an asset holds " + std::to_string(kMaxAssetSpan) +
                   " (use a coarser lattice)");
  }
  while ((std::int64_t{1} << grid.quantization_bits) - 1 < span)
    ++grid.quantization_bits;
  return grid;
}

Result<EncodedSlice> encode_slice(const AssetSlice& slice, const DracoGrid& grid) {
  if (slice.mesh.triangles.empty()) return encode_slice(slice, {}, grid);
  const auto outline = ProvedOutline::of(slice.pslg);
  if (!outline) return bug("slice " + std::to_string(slice.index) + ": " + outline.error().message);
  return encode_slice(slice, *outline, grid);
}

// The bytes just written are decoded again: counts, bounds and proofs refer to the result.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const ProvedOutline& outline,
                                  const DracoGrid& grid) {
  const std::string where = "slice " + std::to_string(slice.index) + ": ";
  if (!nlohmann::json::parse(slice.measures_json, nullptr, false).is_object())
    return bug(where + "its measures are not a JSON object");
  EncodedSlice out;
  out.index = slice.index;
  out.z_mm = slice.z_mm;
  out.T_lps_plane = slice.T_lps_plane;
  out.measures_json = slice.measures_json;
  out.material = slice.material;
  if (slice.mesh.triangles.empty()) return out;
  out.has_hu = !slice.hu.empty();
  out.has_colours = grid.colours && out.has_hu;
  auto bytes = encode_draco(slice.mesh, grid, slice.hu);
  if (!bytes) return bug(where + bytes.error().message);
  AssetSlice decoded;
  if (const auto ok = decode_slice_geometry(*bytes, decoded); !ok)
    return bug(where + "the bytes that Draco wrote do not decode: " + ok.error().message);
  const auto& [vertices, triangles] = decoded.mesh;
  if (vertices.size() != slice.mesh.vertices.size() ||
      triangles.size() != slice.mesh.triangles.size() || decoded.hu.size() != slice.hu.size()) {
    return bug(where + "Draco did not keep every vertex and triangle");
  }
  if (auto ok = check_mesh_against_outline(decoded.mesh, outline); !ok) {
    return bug(where + ok.error().message);
  }
  out.pslg = std::move(decoded.pslg);
  const auto z_at = draco_z_at(*bytes, grid);
  if (!z_at) return bug(where + z_at.error().message);
  out.draco_z_at = *z_at;
  out.draco = std::move(*bytes);
  out.vertices = vertices.size();
  out.triangles = triangles.size();
  out.bounds = box_around(vertices);
  return out;
}

}  // namespace trocar
