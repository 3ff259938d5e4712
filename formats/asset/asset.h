// SPDX-License-Identifier: Apache-2.0
// The asset: one .glb for a scan, with one primitive for each material of each slice. Draco
// compresses the triangles and the HU at their vertices. Planes of HU are compressed separately
// (hu_volume.h); all other data are in the JSON. Lattice coordinates are stored without loss. The
// outline is the boundary of the mesh, so it is stored only on request, for viewers. An index at
// the start of the binary chunk (asset_index.h) lets a reader read some slices without reading the
// others. asset.md specifies the format to the byte. Files of schema 1 can be read but are no
// longer written.
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

inline constexpr int kAssetSchema = 2;  ///< version of the layout that is written; 1 is read, too
/// The statement of intended use in every asset.
inline constexpr const char* kAssetUse = "for training, not for planning";
/// The largest |x|, |y| or |z| of a vertex of an asset, in lattice steps. A float32 holds all whole
/// numbers up to this one exactly.
inline constexpr std::int64_t kMaxAssetCoordinate = (1 << 24) - 1;
/// The largest difference between the x, or between the y, of any two vertices of an asset, in
/// lattice steps. It is half of kMaxAssetCoordinate because Draco's encoder adds 1/2 to the
/// difference in a float32, which needs one more bit.
inline constexpr std::int64_t kMaxAssetSpan = (1 << 23) - 1;

/// One material of one slice. A slice with several materials is several AssetSlices with the same
/// index and plane.
struct AssetSlice {
  int index = 0;    ///< number of the slice in the scan, counted along the slice normal
  double z_mm = 0;  ///< position of the plane's origin along the first slice's normal
  /// Maps the slice plane (u along a row, v along a column, origin at the centre of the first
  /// pixel, mm) to the patient (DICOM LPS, mm). Column 2 is the normal u x v.
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();
  Pslg pslg;       ///< the outline, which consists of exactly the mesh's boundary edges
  SliceMesh mesh;  ///< without triangles if the slice is empty
  /// Measures of the slice: a JSON object as text. Schema 2 stores only `mean_hu`; schema 1 has
  /// more measures (asset.md).
  std::string measures_json = "{}";
  int material = 0;  ///< index in Asset::materials
  /// HU with which viewers colour the mesh: one value for each vertex; empty if the file has none.
  /// Asset::hu has the HU that were measured.
  std::vector<float> hu = {};
};

struct AssetMaterial {
  std::string name;
  std::optional<int> label;  ///< label in the label map, if the input is a label map
};

/// A surface for viewers, printing and other simulators; trocar-run does not use it.
struct AssetSurface {
  int material = 0;
  TriangleSurface surface;  ///< vertices in the patient's frame (LPS)
  /// 99 % of the surface is nearer than this to the material's boundary in the scan.
  double distance_mm = 0;
};

struct Asset {
  Lattice lattice;
  std::vector<AssetSlice> slices;      ///< ascending by index and, within a slice, by material
  std::string generator;               ///< program and version
  std::string parameters_json = "{}";  ///< parameters of the meshing: a JSON object as text
  /// Digest of the input, hexadecimal; empty if unknown. Only files of schema 1 have it, because it
  /// identifies the scan.
  std::string input_digest = {};
  std::vector<AssetMaterial> materials = {{"material", {}}};  ///< at least one
  /// Digest of the input with the user's key, hexadecimal; empty without a key. slice_stack.h
  /// defines the digest.
  std::string input_key_digest = {};
  std::vector<AssetSurface> surfaces = {};
  HuVolume hu = {};           ///< HU of the material and a margin around it; no planes if unknown
  HuVolume context = {};      ///< HU of everything on a coarser grid; no planes if there are none
  bool lines = false;         ///< the file holds the outlines as lines, for viewers
  bool colours = false;       ///< the file holds the HU as vertex colours, for viewers
  int schema = kAssetSchema;  ///< schema of the file that the asset was read from
};

/// The labels from which the asset was made (`labels` in its parameters); empty if a threshold
/// was used instead. Numbers that do not fit an int are left out.
std::vector<int> labels_of(const Asset& asset);
/// Mean HU of the slice's material: `mean_hu` of the measures if they have it, otherwise the mean
/// of AssetSlice::hu over the mesh. Nothing if neither is known.
std::optional<double> mean_hu_of(const AssetSlice& slice);

/// Number of bytes by kind of content.
struct AssetSizes {
  std::uint64_t json_bytes = 0, index_bytes = 0, triangle_bytes = 0, outline_bytes = 0;
  std::uint64_t hu_bytes = 0;       ///< volumes of HU; HU at vertices count as triangle_bytes
  std::uint64_t surface_bytes = 0;  ///< surfaces for display, not included in triangle_bytes
  std::uint64_t triangles = 0;      ///< number of triangles in all slices
};

/// Encodes a .glb. decode_asset() restores the same asset, except that vertices, triangles and
/// rings may be in another order, HU at vertices are rounded (stored_hu()), and `input_digest` is
/// dropped. If `sizes` is not null, sets `*sizes` to the result of asset_sizes(). Errors: kBug if a
/// slice or its JSON text is not valid; kRefused if the asset exceeds kMaxAssetCoordinate,
/// kMaxAssetSpan or 4 GiB.
Result<std::vector<std::uint8_t>> encode_asset(const Asset& asset, AssetSizes* sizes = nullptr);

// The following functions encode in three steps, for scans of thousands of slices. encode_slice()
// may run on several threads, and a mesh may be freed once its slice is encoded.

/// The quantisation grid of a scan whose vertices all lie in the box. Errors: kRefused if the box
/// exceeds kMaxAssetCoordinate or kMaxAssetSpan.
Result<DracoGrid> asset_grid(const Lattice& lattice, const LatticeBox& box);

/// An AssetSlice with its triangles compressed, ready for the file.
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
  /// Offset in `draco` of the z of all vertices, a float, which is 0 until assemble_asset() writes
  /// the z.
  std::size_t draco_z_at = 0;
};
/// Errors: kBug if the slice is not valid or not within the grid's box.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const DracoGrid& grid);
/// Like the function above, but with an outline that has already been proved valid; `slice.pslg` is
/// ignored.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const ProvedOutline& outline,
                                  const DracoGrid& grid);

/// One plane of a volume of HU, compressed (hu_codec.h).
struct EncodedHuPlane {
  int index = 0;  ///< AssetSlice::index
  std::vector<std::uint8_t> bytes;
};
/// A volume of HU with its planes compressed, ready for the file.
struct EncodedHuVolume {
  HuGrid grid;
  std::vector<EncodedHuPlane> planes;  ///< ascending by index
};

/// Assembles a .glb and returns its bytes. `slices` and `hu` replace the slices and the HU of
/// `head`; everything else is taken from `head`. Errors: kBug if the parameters of `head` are not
/// JSON or `slices` do not ascend by index and material; kRefused if the file would exceed 4 GiB.
Result<std::vector<std::uint8_t>> assemble_asset(const Asset& head,
                                                 std::vector<EncodedSlice> slices,
                                                 AssetSizes* sizes = nullptr,
                                                 const std::vector<EncodedHuVolume>& hu = {});

/// Counts the bytes of a .glb by kind of content. Errors: kRefused if the container is not valid.
Result<AssetSizes> asset_sizes(std::span<const std::uint8_t> glb, const std::string& name);

/// Selects the slices to decode. Slices that are not selected keep their metadata and have an empty
/// mesh and PSLG.
struct DecodeOptions {
  bool all = true;
  std::vector<int> slice_indices;  ///< AssetSlice::index values; used if `all` is false
};

/// Decodes a file and checks every size and index in it. The function does not prove the invariants
/// of the geometry; call verify_asset() for that. `name` stands for the file in messages. Errors:
/// kRefused if the file is not a valid asset.
Result<Asset> decode_asset(std::span<const std::uint8_t> glb, const std::string& name,
                           const DecodeOptions& options = {});
Result<Asset> read_asset(const std::filesystem::path& file);

/// Some slices of a file.
struct AssetPart {
  Asset asset;                   ///< contains the requested slices only; its generator may be empty
  std::size_t asset_slices = 0;  ///< number of slices in the file, each counted once
  std::uint64_t file_bytes = 0, read_bytes = 0;
};
/// Reads the slices whose AssetSlice::index is in `slice_indices`, with all their materials and
/// their planes of Asset::hu. Asset::context and surfaces are not read. Only the bytes of these
/// slices are read, so time, memory and bytes read do not depend on the number of other slices
/// (asset_index.h). A file without a slice index is read completely. Errors: kRefused if a slice
/// does not exist, or if decode_asset() would refuse it.
Result<AssetPart> read_asset_part(const std::filesystem::path& file,
                                  std::vector<int> slice_indices);
Result<AssetPart> decode_asset_part(std::span<const std::uint8_t> glb, const std::string& name,
                                    std::vector<int> slice_indices);

/// Returns the elements of Asset::slices that belong to one slice, one for each of its materials.
/// `first` must be the index of the first of these elements.
std::span<const AssetSlice> materials_of_slice(const Asset& asset, std::size_t first);
/// Number of slices. A slice with several materials counts once.
std::size_t slice_count(const Asset& asset);

/// Proves the invariants of every mesh (mesh_validity.h) and surface (triangle_surface.h). Also
/// proves that the materials of a slice have common borders and do not overlap (shared_borders.h),
/// and checks that the matrix of every plane is a rotation within 1e-4. Errors: kRefused if a proof
/// or check fails; the message contains the slice and the position.
Result<void> verify_asset(const Asset& asset, const std::string& name);

}  // namespace trocar
