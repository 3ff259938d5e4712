// SPDX-License-Identifier: Apache-2.0
// The asset: one .glb for a scan, with one primitive for each material of each slice. Draco
// compresses the triangles and the HU at their vertices; all other data are in the JSON. Lattice
// coordinates are stored without loss and only once, because the outline is the boundary of the
// mesh. An index at the start of the binary chunk (asset_index.h) lets a reader read some slices
// without the others. asset.md specifies the format to the byte. Files of schema 1 can be read but
// are no longer written.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/asset/draco_mesh.h"
#include "formats/asset/hu_volume.h"
#include "formats/base/result.h"
#include "formats/geometry/lattice.h"
#include "formats/geometry/lattice_box.h"
#include "formats/geometry/proved_outline.h"
#include "formats/geometry/slice_mesh.h"
#include "formats/geometry/triangle_surface.h"

namespace trocar {

inline constexpr int kAssetSchema = 2;  ///< schema that is written; 1 is read, too
/// The statement of intended use in every asset.
inline constexpr const char* kAssetUse = "for training, not for planning";
/// Lattice extent (max - min over the whole scan) that a float32 position and
/// Draco's quantiser carry exactly.
inline constexpr std::int64_t kMaxAssetExtent = (1 << 24) - 1;
/// The largest difference of two x, or of two y, of an asset's slices, in lattice steps. It is half
/// of the range above because Draco's encoder adds 1/2 to the difference in a float32.
inline constexpr std::int64_t kMaxAssetSpan = (1 << 23) - 1;

struct AssetSlice {
  int index = 0;    ///< position in the scan, along the slice normal
  double z_mm = 0;  ///< position of the plane's origin along the first slice's normal
  /// Slice plane (u along a row, v along a column, origin at the centre of the
  /// first pixel, mm) -> patient (DICOM LPS, mm). Column 2 is the normal u x v.
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();
  Pslg pslg;       ///< the outline: exactly the mesh's boundary edges
  SliceMesh mesh;  ///< without triangles if the slice is empty
  /// Measures of the slice: a JSON object as text. Schema 2 stores only `mean_hu`; schema 1 has
  /// more measures (asset.md).
  std::string measures_json = "{}";
  int material = 0;  ///< index in Asset::materials
  /// HU by which viewers colour the mesh: one value for each vertex; empty if the file has none.
  /// Asset::hu has the HU as they were measured.
  std::vector<float> hu = {};
};

struct AssetMaterial {
  std::string name;
  std::optional<int> label;  ///< label in the label map, if the input is one
};

/// A surface for viewers, printing and other simulators; trocar-run does not use it.
struct AssetSurface {
  int material = 0;
  TriangleSurface surface;  ///< vertices in the patient's frame (LPS)
  double distance_mm =
      0;  ///< 99 % of it is nearer than this to the material's boundary in the scan
};

struct Asset {
  Lattice lattice;
  std::vector<AssetSlice> slices;      ///< ascending by index, then material
  std::string generator;               ///< program and version
  std::string parameters_json = "{}";  ///< parameters of the meshing: a JSON object as text
  /// Digest of the input, hex; empty if unknown. Schema 1 only, since it identifies the scan.
  std::string input_digest = {};
  std::vector<AssetMaterial> materials = {{"material", {}}};  ///< at least one
  /// Digest of the input (defined in slice_stack.h) with the user's key, hex; empty without a key.
  std::string input_key_digest = {};
  std::vector<AssetSurface> surfaces = {};
  HuVolume hu = {};           ///< HU of the material and a margin around it; no planes if unknown
  HuVolume context = {};      ///< HU of everything, coarser; no planes if the file has none
  bool lines = false;         ///< the file holds the outlines as lines, for viewers
  bool colours = false;       ///< the file holds the HU as vertex colours, for viewers
  int schema = kAssetSchema;  ///< schema of the file that the asset was read from
};

/// The labels from which the asset was made (`labels` in its parameters); empty if it was made by a
/// threshold. Numbers that do not fit an int are left out.
std::vector<int> labels_of(const Asset& asset);
/// Mean HU of the slice's material, if known: `mean_hu` of its measures or, without it, the mean of
/// `hu` over the mesh.
std::optional<double> mean_hu_of(const AssetSlice& slice);

/// Number of bytes by kind of content.
struct AssetSizes {
  std::uint64_t json_bytes = 0, index_bytes = 0, triangle_bytes = 0, outline_bytes = 0;
  std::uint64_t hu_bytes = 0;       ///< HU, without those at vertices
  std::uint64_t surface_bytes = 0;  ///< surfaces for display, not included in the numbers above
  std::uint64_t triangles = 0;      ///< number of triangles in all slices
};

/// Encodes a .glb. decode_asset() restores the same asset, except that vertices, triangles and
/// rings may be in another order, HU are rounded (stored_hu()), and `input_digest` is dropped. If
/// `sizes` is not null, sets it to the result of asset_sizes(). Errors: (bug) a slice or its JSON
/// text is not valid; (refused) the asset exceeds kMaxAssetExtent.
Result<std::vector<std::uint8_t>> encode_asset(const Asset& asset, AssetSizes* sizes = nullptr);

// The following functions encode in three steps, for scans of thousands of slices. encode_slice()
// may run on several threads, and a mesh may be freed once its slice is encoded.

/// The quantisation grid of a scan whose vertices all lie in the box. Errors: (refused) the box
/// exceeds kMaxAssetExtent.
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
  LatticeBox bounds;  ///< box around the vertices
  int material = 0;
  bool has_hu = false, has_colours = false;
  std::size_t draco_z_at = 0;  ///< offset in `draco` of the vertices' z, which is still 0
};
/// Errors: (bug) the slice is not valid or not within the grid's box.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const DracoGrid& grid);
/// Like the function above, with an outline that is already proved; `slice.pslg` is ignored.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const ProvedOutline& outline,
                                  const DracoGrid& grid);

/// A volume of HU with its planes compressed (hu_codec.h), ready for the file.
struct EncodedHuPlane {
  int index = 0;  ///< AssetSlice::index
  std::vector<std::uint8_t> bytes;
};
struct EncodedHuVolume {
  HuGrid grid;
  std::vector<EncodedHuPlane> planes;  ///< ascending by index
};

/// Returns the file's bytes. Everything is taken from `head` except its slices and HU, which
/// `slices` and `hu` replace.
Result<std::vector<std::uint8_t>> assemble_asset(const Asset& head,
                                                 std::vector<EncodedSlice> slices,
                                                 AssetSizes* sizes = nullptr,
                                                 const std::vector<EncodedHuVolume>& hu = {});

/// Counts a file's bytes. Errors: (refused) the file is not an asset's container.
Result<AssetSizes> asset_sizes(std::span<const std::uint8_t> glb, const std::string& name);

/// Selects the slices to decode. The others keep their metadata and have an empty mesh and PSLG.
struct DecodeOptions {
  bool all = true;
  std::vector<int> slice_indices;  ///< AssetSlice::index values; used if !all
};

/// Decodes a file and checks every size and index. (verify_asset() proves the geometry's
/// invariants.) Messages call the file `name`. Errors: (refused).
Result<Asset> decode_asset(std::span<const std::uint8_t> glb, const std::string& name,
                           const DecodeOptions& options = {});
Result<Asset> read_asset(const std::filesystem::path& file);

/// Some slices of a file.
struct AssetPart {
  Asset asset;                   ///< contains the requested slices only; its generator may be empty
  std::size_t asset_slices = 0;  ///< number of slices in the file, whatever their materials
  std::uint64_t file_bytes = 0, read_bytes = 0;
};
/// Reads the slices with these AssetSlice::index, with all their materials and their planes of
/// Asset::hu, but without Asset::context and surfaces. Only the bytes of these slices are read, so
/// time, memory and bytes read do not depend on the number of other slices (asset_index.h). A file
/// without a slice index is read completely. Errors: (refused) a slice does not exist, or
/// decode_asset() would refuse it.
Result<AssetPart> read_asset_part(const std::filesystem::path& file,
                                  std::vector<int> slice_indices);
Result<AssetPart> decode_asset_part(std::span<const std::uint8_t> glb, const std::string& name,
                                    std::vector<int> slice_indices);

/// The entries of the slice whose first entry is `asset.slices[first]`, one for each material.
std::span<const AssetSlice> materials_of_slice(const Asset& asset, std::size_t first);
/// Number of slices, each counted once, whatever its materials.
std::size_t slice_count(const Asset& asset);

/// Proves the invariants of every mesh (mesh_validity.h) and surface (triangle_surface.h). Also
/// proves that the materials of a slice have common borders and do not overlap (shared_borders.h).
/// Errors: (refused); the message contains the slice and the position.
Result<void> verify_asset(const Asset& asset, const std::string& name);

}  // namespace trocar
