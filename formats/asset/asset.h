// SPDX-License-Identifier: Apache-2.0
// The asset: one .glb file for a scan, with one mesh for each material of each slice. Draco
// compresses the triangles and the HU at their vertices; lattice coordinates stay exact. Planes of
// HU are compressed separately (hu_codec.h). Names, transforms and parameters are in the JSON. An
// outline is the boundary of its mesh, so outlines are stored only on request, for viewers. The
// file has an index of its slices (asset_index.h), so a reader can read some slices and skip the
// rest of the file.
// asset.md specifies the format to the byte.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/asset/draco_mesh.h"
#include "formats/asset/hu_codec.h"
#include "formats/base/result.h"
#include "formats/mesh/lattice.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/mesh/triangle_surface.h"

namespace trocar {

inline constexpr int kAssetSchema = 2;  ///< version of the layout
/// The statement of intended use in every asset.
inline constexpr const char* kAssetUse = "for training, not for planning";
/// The largest |x|, |y| or |z| of a vertex of an asset, in lattice steps. A float32 holds all whole
/// numbers up to this limit exactly.
inline constexpr std::int64_t kMaxAssetCoordinate = (1 << 24) - 1;
/// The largest difference between the x of any two vertices of an asset, and between their y, in
/// lattice steps. The limit is half of kMaxAssetCoordinate, because Draco's encoder adds 1/2 to the
/// difference in a float32, and this sum needs one more bit.
inline constexpr std::int64_t kMaxAssetSpan = (1 << 23) - 1;

/// One material of one slice. A slice with several materials is several AssetSlices with the same
/// index and plane.
struct AssetSlice {
  int index = 0;    ///< number of the slice in the scan; ascends along the slice normal
  double z_mm = 0;  ///< height of the plane's origin along the first slice's normal (LPS)
  /// Maps the slice plane (u along a row, v along a column, origin at the centre of the first
  /// pixel, mm) to the patient (DICOM LPS, mm). Column 2 is the normal u x v.
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();
  Pslg pslg;       ///< the outline, which consists of exactly the mesh's boundary edges
  SliceMesh mesh;  ///< without triangles if the slice is empty
  /// Measures of the slice: a JSON object as text. A file stores only `mean_hu`.
  std::string measures_json = "{}";
  int material = 0;  ///< index in Asset::materials
  /// HU at the vertices, with which viewers colour the mesh; empty if the file has none. The HU of
  /// the scan itself are in Asset::hu.
  std::vector<float> hu = {};
};

struct AssetMaterial {
  std::string name;
  std::optional<int> label;  ///< label of the material, if the input is a label map
};

/// A closed surface for viewers, printing and other simulators; trocar-run does not use surfaces.
struct AssetSurface {
  int material = 0;
  TriangleSurface surface;  ///< vertices in the patient's frame (LPS)
  /// 99 % of the surface lies within this distance of the material's boundary in the scan.
  double distance_mm = 0;
};

struct Asset {
  Lattice lattice;
  std::vector<AssetSlice> slices;      ///< ascending by index and, within a slice, by material
  std::string generator;               ///< program and version
  std::string parameters_json = "{}";  ///< parameters of the meshing: a JSON object as text
  std::vector<AssetMaterial> materials = {{"material", {}}};  ///< at least one
  /// Keyed digest of the input, hexadecimal; empty without a key. With this digest, only a holder
  /// of the user's key can recognise the input (digest_input() in pipeline/read).
  std::string input_key_digest = {};
  std::vector<AssetSurface> surfaces = {};
  HuVolume hu = {};       ///< HU of the material and a margin around it; no planes if absent
  HuVolume context = {};  ///< HU of everything, on a coarser grid; no planes if absent
  bool lines = false;     ///< the file holds the outlines as lines, for viewers
  bool colours = false;   ///< the file holds the HU as vertex colours, for viewers
};

/// The labels from which the asset was made (`labels` in its parameters), without numbers that do
/// not fit into an int; empty if the asset was made with a threshold.
std::vector<int> labels_of(const Asset& asset);
/// Mean HU of the slice's material: `mean_hu` of AssetSlice::measures_json if present,
/// otherwise the mean of AssetSlice::hu over the mesh, otherwise std::nullopt.
std::optional<double> mean_hu_of(const AssetSlice& slice);

/// Number of bytes of each kind of content.
struct AssetSizes {
  std::uint64_t json_bytes = 0, index_bytes = 0, triangle_bytes = 0, outline_bytes = 0;
  std::uint64_t hu_bytes = 0;       ///< volumes of HU; HU at vertices count as triangle_bytes
  std::uint64_t surface_bytes = 0;  ///< surfaces for display, not included in triangle_bytes
  std::uint64_t triangles = 0;      ///< number of triangles in all slices
};

/// Encodes an asset as .glb. decode_asset() restores the asset with these differences: vertices,
/// triangles and rings may be in another order; HU are rounded to the steps in which they are
/// stored, and `mean_hu` to 0.1; all other measures are dropped. If `sizes` is
/// not null, sets `*sizes` to the result of asset_sizes(). Errors: those of asset_grid(),
/// encode_slice() and assemble_asset(); kBug if a plane of HU does not fit the outlines of its
/// slice; kRefused if hu_mask() (hu_codec.h) refuses a plane of HU.
Result<std::vector<std::uint8_t>> encode_asset(const Asset& asset, AssetSizes* sizes = nullptr);

// The next functions encode step by step, for scans of thousands of slices: asset_grid(), then
// encode_slice() for each slice, then assemble_asset(). Several threads may call encode_slice(),
// and a mesh may be freed once its slice is encoded.

/// Returns the grid on which Draco stores the coordinates of a scan. Precondition: `box` holds all
/// vertices of the scan. Errors: kRefused if the box exceeds kMaxAssetCoordinate or kMaxAssetSpan.
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
  /// Offset in `draco` of a float, which is the z of all vertices. The float is 0 until
  /// assemble_asset() sets it.
  std::size_t draco_z_at = 0;
};
/// Encodes one slice. Errors: kBug if the slice is not valid or not within the grid's box.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const DracoGrid& grid);
/// Like the function above, but with an outline that has already been proved valid; `slice.pslg` is
/// ignored.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const ProvedOutline& outline,
                                  const DracoGrid& grid);

/// One plane of a volume of HU, compressed (hu_codec.h).
struct EncodedHuPlane {
  int index = 0;  ///< AssetSlice::index of the plane's slice
  std::vector<std::uint8_t> bytes;
};
/// A volume of HU with its planes compressed, ready for the file.
struct EncodedHuVolume {
  HuGrid grid;
  std::vector<EncodedHuPlane> planes;  ///< ascending by index
};

/// Checks whether an asset can hold this number of entries, which are the elements of `slices` in
/// assemble_asset(). Errors: kRefused if it cannot; the message does not contain the input's name.
Result<void> check_entry_count(std::size_t entries);

/// Assembles a .glb and returns its bytes. `slices` and `hu` replace the slices and the HU of
/// `head`; everything else is taken from `head`. Errors: those of check_entry_count(); kBug if the
/// parameters of `head` are not JSON, if `slices` do not ascend by index and material, if a slice
/// names a material that `head` does not have, or if a surface is not valid; kRefused if the file
/// would exceed 4 GiB, or if a surface is too large.
Result<std::vector<std::uint8_t>> assemble_asset(const Asset& head,
                                                 std::vector<EncodedSlice> slices,
                                                 AssetSizes* sizes = nullptr,
                                                 const std::vector<EncodedHuVolume>& hu = {});

/// Counts the bytes of each kind of content in a .glb. Errors: kRefused if parse_gltf()
/// (gltf_document.h) refuses the file.
Result<AssetSizes> asset_sizes(std::span<const std::uint8_t> glb, const std::string& name);

/// Selects the slices to decode. A slice that is not selected has its metadata, but no mesh and no
/// outline. If `all` is false, Asset::context and the surfaces are not decoded either.
struct DecodeOptions {
  bool all = true;
  std::vector<int> slice_indices;  ///< AssetSlice::index of each slice to decode, if not `all`
};

/// Decodes a file and checks every size and index in the file. Whether the meshes are valid is not
/// checked: call verify_asset(). `name` names the file in error messages. Errors: kRefused if the
/// file is not a valid asset.
Result<Asset> decode_asset(std::span<const std::uint8_t> glb, const std::string& name,
                           const DecodeOptions& options = {});
Result<Asset> read_asset(const std::filesystem::path& file);

/// Some slices of a file.
struct AssetPart {
  /// Only the requested slices. `generator` is empty if the file has a slice index.
  Asset asset;
  std::size_t asset_slices = 0;  ///< slice_count() of the complete asset
  std::uint64_t file_bytes = 0, read_bytes = 0;
};
/// Reads the slices whose AssetSlice::index is in `slice_indices`, with all their materials and
/// their planes of Asset::hu. Asset::context and surfaces are not read. If the file has a slice
/// index (asset_index.h), only the bytes of these slices are read, so time, memory and bytes read
/// hardly depend on the size of the file. A file without a slice index is read completely. Errors:
/// kRefused if a slice does not exist, if the file cannot be read, or if the bytes that are read
/// are not those of a valid asset.
Result<AssetPart> read_asset_part(const std::filesystem::path& file,
                                  std::vector<int> slice_indices);
Result<AssetPart> decode_asset_part(std::span<const std::uint8_t> glb, const std::string& name,
                                    std::vector<int> slice_indices);

/// Returns the consecutive elements of Asset::slices that belong to one slice, one element for each
/// material of the slice. `first` must be the position in Asset::slices of the first of them.
std::span<const AssetSlice> materials_of_slice(const Asset& asset, std::size_t first);
/// Number of slices of an asset. A slice with several materials counts once.
std::size_t slice_count(const Asset& asset);

/// Proves that every mesh matches its outline (mesh_validity.h), that the materials of a slice lie
/// in one plane, do not overlap and leave no gap along common borders (shared_borders.h), and that
/// every surface is closed (triangle_surface.h). Checks for every slice with a mesh that the
/// plane's matrix is a rotation within 1e-4, and that HU at vertices are there for all vertices or
/// for none. Errors: kRefused if a proof or check fails; the message names the file, and the slice
/// and position if there are any.
Result<void> verify_asset(const Asset& asset, const std::string& name);

// Joins the materials of each slice into one sheet. Materials are labels, for example of vertebrae,
// and a needle that crosses from one label to the next must not feel the border between them.

/// Joins the materials of each slice into one mesh with the outline of their union
/// (weld_regions()). The HU of merged vertices are averaged. If one of the materials has no HU at
/// vertices, the joined mesh has none. If the mean HU of each material is known, the joined mesh
/// gets the mean of these values, weighted by area. The mesh of a slice with one material is
/// unchanged. If any slice had several materials, the asset afterwards has one material, to which
/// all slices belong; otherwise nothing is changed. O(n log n). Errors: kRefused if a mesh is not
/// valid (check_mesh_against_pslg()), or if materials overlap (check_shared_borders()) or lie in
/// different planes. The message has the file and the slice, and the asset is unchanged.
Result<void> weld_materials(Asset& asset, const std::string& name);

/// Computes HU at the vertices, with which viewers can colour the meshes. Fills AssetSlice::hu of
/// each slice where it is empty and where Asset::hu has a plane of the slice. The HU of a triangle
/// are the mean of Asset::hu at four points inside the triangle. The value at a vertex is the mean
/// of the triangles around the vertex, weighted by area; it is 0 if none of these triangles has a
/// HU. (The HU at the vertex itself are not used: most vertices lie on the outline, where the HU
/// are partly those of the surroundings.) Call this function before weld_materials().
void add_hu_at_vertices(Asset& asset);

}  // namespace trocar
