// SPDX-License-Identifier: Apache-2.0
// The asset: one .glb a scan, one mesh and node a slice. Triangles are
// compressed by Draco, outlines are an uncompressed LINES primitive, the rest is
// in `extras.trocar`. Lattice integers survive bit for bit.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "formats/lattice.h"
#include "formats/result.h"
#include "formats/slice_mesh.h"

namespace trocar {

inline constexpr int kAssetSchema = 1;
/// Lattice extent (max - min over the whole scan) that a float32 position and
/// Draco's quantiser carry exactly.
inline constexpr std::int64_t kMaxAssetExtent = (1 << 24) - 1;

struct AssetSlice {
  int index = 0;    ///< position in the scan, along the slice normal
  double z_mm = 0;  ///< of the plane's origin along the normal of the first slice
  /// Slice plane (u along a row, v along a column, origin at the centre of the
  /// first pixel, mm) -> patient (DICOM LPS, mm). Column 2 is the normal u x v.
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();
  Pslg pslg;       ///< the outline that the mesh has exactly
  SliceMesh mesh;  ///< empty if there is no material in the slice
  nlohmann::json measures =
      nlohmann::json::object();  ///< per-slice error figures, as in the report
};

struct Asset {
  Lattice lattice;
  std::vector<AssetSlice> slices;  ///< in ascending index
  std::string generator;           ///< program and version
  nlohmann::json parameters = nlohmann::json::object();
  std::string input_digest;  ///< of the input (slice_stack.h says how), hex; empty if unknown
};

/// Runs f(0) .. f(n - 1) in any order, perhaps in parallel.
using ForEach = std::function<void(std::size_t n, const std::function<void(std::size_t)>& f)>;

/// Where an asset's bytes go.
struct AssetSizes {
  std::uint64_t json_bytes = 0, triangle_bytes = 0, outline_bytes = 0, triangles = 0;
};

/// The .glb's bytes. What comes back from decode_asset() is what went in, but
/// for the order of a mesh's vertices and triangles. Fails (bug) if a slice is
/// not valid, (refused) if it exceeds kMaxAssetExtent. `for_each` may spread the slices'
/// compression over threads; the bytes do not depend on it. `sizes`, if not null, becomes what
/// asset_sizes() would say. Takes the asset over: each mesh is given up once compressed.
Result<std::vector<std::uint8_t>> encode_asset(Asset asset, const ForEach& for_each = {},
                                               AssetSizes* sizes = nullptr);
Result<AssetSizes> asset_sizes(std::span<const std::uint8_t> glb, const std::string& name);

/// Which slices to decode; the others keep their metadata and have an empty mesh and PSLG.
struct DecodeOptions {
  bool all = true;
  std::vector<int> slice_indices;  ///< AssetSlice::index values; used if !all
};

/// Decodes and checks every size and index. `name` is used in messages. The geometry's
/// invariants are proved by verify_asset(), not here.
Result<Asset> decode_asset(std::span<const std::uint8_t> glb, const std::string& name,
                           const DecodeOptions& options = {});
Result<Asset> read_asset(const std::filesystem::path& file, const DecodeOptions& options = {});

/// Proves the invariants of every slice (mesh_validity.h). Names slice and place.
Result<void> verify_asset(const Asset& asset, const std::string& name);

}  // namespace trocar
