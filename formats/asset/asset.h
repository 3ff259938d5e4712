// SPDX-License-Identifier: Apache-2.0
// The asset: one .glb for a scan, one primitive for each material of each slice. Triangles, and
// the HU at their vertices, are compressed by Draco; everything else is in the JSON. Lattice
// coordinates are stored without loss, and once: the outline is the boundary of the mesh. An index
// at the start of the binary chunk (asset_index.h) lets a reader take some slices without the rest.
// The format to the byte: asset.md. Files of schema 1 are read, and not written.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/asset/draco_mesh.h"
#include "formats/base/result.h"
#include "formats/geometry/lattice.h"
#include "formats/geometry/lattice_box.h"
#include "formats/geometry/proved_outline.h"
#include "formats/geometry/slice_mesh.h"
#include "formats/geometry/triangle_surface.h"

namespace trocar {

inline constexpr int kAssetSchema = 2;  ///< that is written; 1 is read, too
/// What every asset says of its use.
inline constexpr const char* kAssetUse = "for training, not for planning";
/// Lattice extent (max - min over the whole scan) that a float32 position and
/// Draco's quantiser carry exactly.
inline constexpr std::int64_t kMaxAssetExtent = (1 << 24) - 1;

struct AssetSlice {
  int index = 0;    ///< position in the scan, along the slice normal
  double z_mm = 0;  ///< of the plane's origin along the normal of the first slice
  /// Slice plane (u along a row, v along a column, origin at the centre of the
  /// first pixel, mm) -> patient (DICOM LPS, mm). Column 2 is the normal u x v.
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();
  Pslg pslg;       ///< the outline: exactly the mesh's boundary edges
  SliceMesh mesh;  ///< empty if there is no material in the slice
  /// Figures of the slice: a JSON object as text. Schema 2 keeps of them `mean_hu` only, and that
  /// only where `hu` is empty; schema 1 has more (asset.md).
  std::string measures_json = "{}";
  int material = 0;            ///< place in Asset::materials
  std::vector<float> hu = {};  ///< at each vertex of the mesh; empty if unknown
};

struct AssetMaterial {
  std::string name;
  std::optional<int> label;  ///< of the label map
};

/// For viewers, printing and other simulators; trocar-run does not use it.
struct AssetSurface {
  int material = 0;
  TriangleSurface surface;  ///< in the patient's frame (LPS)
  double distance_mm = 0;   ///< 99 % of it are nearer to the bound of the scan's material
};

struct Asset {
  Lattice lattice;
  std::vector<AssetSlice> slices;      ///< ascending by index, then material
  std::string generator;               ///< program and version
  std::string parameters_json = "{}";  ///< what it was made with: a JSON object as text
  /// Of the input, hex; empty if unknown. Schema 1 only: it identifies the scan.
  std::string input_digest = {};
  std::vector<AssetMaterial> materials = {{"material", {}}};  ///< at least one
  /// Digest of the input (slice_stack.h says how) with the user's key, hex; empty without a key.
  std::string input_key_digest = {};
  std::vector<AssetSurface> surfaces = {};
  bool lines = false;         ///< does the file hold the outlines as lines, for viewers?
  bool colours = false;       ///< does it hold the HU as colours of the vertices, for viewers?
  int schema = kAssetSchema;  ///< of the file that it was read from
};

/// The labels of the label map that the asset was made from (`labels` in its parameters); empty if
/// it was made by a threshold. Numbers that are no int are left out.
std::vector<int> labels_of(const Asset& asset);
/// Mean HU of the slice's material, if it is known: of its field over its mesh, without a field
/// `mean_hu` of its measures.
std::optional<double> mean_hu_of(const AssetSlice& slice);

/// Where an asset's bytes go.
struct AssetSizes {
  std::uint64_t json_bytes = 0, index_bytes = 0, triangle_bytes = 0, outline_bytes = 0;
  std::uint64_t surface_bytes = 0;  ///< of surfaces for display; not in the two numbers beside it
  std::uint64_t triangles = 0;
};

/// The .glb's bytes. decode_asset() gives the same asset again, except for the order of a mesh's
/// vertices and triangles, and of rings; HU are rounded (stored_hu()). `input_digest` is left out.
/// Fails (bug) if a slice or its JSON text is not valid, (refused) if the asset exceeds
/// kMaxAssetExtent. `sizes`, if not null, is set to what asset_sizes() gives.
Result<std::vector<std::uint8_t>> encode_asset(const Asset& asset, AssetSizes* sizes = nullptr);

// The same in three steps, for scans of thousands of slices: encode_slice() may run on several
// threads, and a mesh may be freed once its slice is encoded.

/// The quantisation grid of a scan whose vertices all lie in the box. Fails (refused) beyond
/// kMaxAssetExtent.
Result<DracoGrid> asset_grid(const Lattice& lattice, const LatticeBox& box);

/// A slice with its triangles compressed, ready for the file.
struct EncodedSlice {
  int index = 0;
  double z_mm = 0;
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();
  Pslg pslg;
  std::string measures_json;
  std::vector<std::uint8_t> draco;
  std::size_t vertices = 0, triangles = 0;
  LatticeBox bounds;  ///< of the vertices
  int material = 0;
  bool has_hu = false, has_colours = false;
  std::size_t draco_z_at = 0;  ///< of the vertices' z in `draco`, which is 0 so far
};
/// Fails (bug) if the slice is not valid or not within the grid's box.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const DracoGrid& grid);
/// The same with an outline that is proved already; `slice.pslg` does not count.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const ProvedOutline& outline,
                                  const DracoGrid& grid);

/// The file's bytes. Of `head` everything but the slices is used; `slices` take their place.
Result<std::vector<std::uint8_t>> assemble_asset(const Asset& head,
                                                 std::vector<EncodedSlice> slices,
                                                 AssetSizes* sizes = nullptr);

/// Where a file's bytes go. Refused if it is not an asset's container.
Result<AssetSizes> asset_sizes(std::span<const std::uint8_t> glb, const std::string& name);

/// Which slices to decode; the others keep their metadata and have an empty mesh and PSLG.
struct DecodeOptions {
  bool all = true;
  std::vector<int> slice_indices;  ///< AssetSlice::index values; used if !all
};

/// Decodes and checks every size and index. `name` is used in messages. verify_asset() proves the
/// geometry's invariants; this does not.
Result<Asset> decode_asset(std::span<const std::uint8_t> glb, const std::string& name,
                           const DecodeOptions& options = {});
Result<Asset> read_asset(const std::filesystem::path& file);

/// Some slices of a file.
struct AssetPart {
  Asset asset;                   ///< with the requested slices only; its generator may be empty
  std::size_t asset_slices = 0;  ///< number of slices in the file, each counted once
  std::uint64_t file_bytes = 0, read_bytes = 0;
};
/// The slices with these AssetSlice::index, all materials of each. Only their bytes are read: time,
/// memory and bytes read do not depend on how many others the file has (asset_index.h). A file
/// without a slice index is read whole. Refused, naming the file: a slice that is not there, and a
/// slice that decode_asset() would refuse.
Result<AssetPart> read_asset_part(const std::filesystem::path& file,
                                  std::vector<int> slice_indices);
Result<AssetPart> decode_asset_part(std::span<const std::uint8_t> glb, const std::string& name,
                                    std::vector<int> slice_indices);

/// The entries of the slice whose first one is `asset.slices[first]`: one for each of its
/// materials.
std::span<const AssetSlice> materials_of_slice(const Asset& asset, std::size_t first);
/// Each counted once, whatever its materials.
std::size_t slice_count(const Asset& asset);

/// Proves the invariants of every mesh (mesh_validity.h) and surface (triangle_surface.h), and that
/// the materials of a slice do not overlap and share their borders (check_shared_borders() of
/// shared_borders.h), or names it and the place.
Result<void> verify_asset(const Asset& asset, const std::string& name);

}  // namespace trocar
