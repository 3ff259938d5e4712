// SPDX-License-Identifier: Apache-2.0
// A slice's geometry in the file: as the JSON describes it, as Draco payload; volumes of HU.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/gltf.h"
#include "formats/asset/gltf_document.h"
#include "formats/base/files.h"
#include "formats/base/result.h"
#include "formats/mesh/triangle_surface.h"

namespace trocar {

// The geometry of slices as the JSON of a file describes it, before any payload is decoded.
// Internal to formats/; includes tinygltf (see gltf_document.h).

/// An entry (one material of one slice) as the JSON describes it. `record` is filled except for the
/// location of the node's text and the checksum.
struct StatedEntry {
  EntryRecord record;
  std::uint32_t vertices = 0, triangles = 0;
  LatticePoint low, high;  ///< box around the vertices
  std::int32_t z = 0;      ///< height of all vertices, steps
  bool has_hu = false, has_colours = false, has_lines = false;
  /// Location of the lines in the binary chunk's data, and the size of an index in their segments.
  std::uint32_t outline_offset = 0, outline_vertices = 0;
  std::uint32_t segments_offset = 0, segment_index_bytes = 0;

  std::uint64_t outline_bytes() const { return std::uint64_t{12} * outline_vertices; }
  std::uint64_t segments_bytes() const {
    return std::uint64_t{2} * outline_vertices * segment_index_bytes;
  }
};
/// Returns the entries of a node. AssetSlice::index of the first entry is `first_index`, and each
/// further entry has the next index. If the node has no mesh, there is a single entry without
/// geometry. Otherwise each primitive of triangles is an entry, and the primitive after it may have
/// the entry's outline as lines. Errors: kRefused if the primitives are not those of an asset; the
/// message has the slice.
Result<std::vector<StatedEntry>> stated_entries(const tinygltf::Model& model,
                                                const tinygltf::Node& node, int first_index,
                                                const Asset& asset);
/// Counts the entries of all nodes in `nodes`, without checking the entries.
std::size_t count_entries(const tinygltf::Model& model, const std::vector<int>& nodes);

// Decodes a slice of an asset. Two parts of the file describe the slice: its glTF node, which is
// JSON text, and its payload, which is its mesh as Draco has compressed it (draco_mesh.h).
// The readers of complete files and of some slices both use these functions. Internal to formats/.

// An entry is one material of one slice. Consecutive entries may share a glTF node. The nodes
// (asset.md) are a tree:
//   node 0    maps LPS in lattice steps to glTF's frame in metres
//   node 1    the frame, the only child of node 0; its transform holds for all slices
//   node 2    the list, the only child of the frame; its children are the nodes of entries
//   node 3    the first node of entries; others follow
// A reader that reads only some slices always needs the text of node 1. This text is short, because
// node 2, and not node 1, lists the nodes of all entries.
inline constexpr std::size_t kFrameNode = 1, kListNode = 2, kFirstEntryNode = 3;
/// The largest number of entries that may share a node. To read an entry, a reader must read the
/// text of the whole node, so this number limits the length of that text.
inline constexpr std::size_t kMaxNodeEntries = 32;

/// Parses JSON text from a file. Errors: kRefused if the text does not parse, or is nested deeper
/// than 64.
Result<nlohmann::json> parse_json_text(std::span<const std::uint8_t> text);

/// The member `trocar` of the extras of a glTF element, or null.
nlohmann::json trocar_extras(const nlohmann::json& extras);

/// Reads the document's extras, which describe the whole asset, into `asset`. Returns the number of
/// slices that the extras state. Errors: kRefused if the extras are not those of an
/// asset; the message begins with `name`.
Result<std::size_t> read_document_extras(const nlohmann::json& extras, Asset& asset,
                                         const std::string& name);

/// The transform in a node's `translation` or `matrix`, converted from lattice steps to mm; the
/// identity if the node has neither. Errors: kRefused if the node has both or another kind of
/// transform, or if a number is not finite.
Result<Eigen::Affine3d> transform_of_node(const nlohmann::json& node, const Lattice& lattice);

/// The contents of a node. The node has one or more entries. From entry to entry
/// AssetSlice::index increases by 1.
struct EntryNode {
  /// AssetSlice::index of the node's first entry. If absent, the index is one more than that of the
  /// previous entry in the file, or 0 for the first entry in the file.
  std::optional<int> index;
  std::optional<double> z_mm;   ///< AssetSlice::z_mm; if absent, z_of_plane() gives it
  std::vector<double> mean_hu;  ///< one value for each entry, or empty
  Eigen::Affine3d transform = Eigen::Affine3d::Identity();  ///< the node's transform; lengths in mm
};
/// Reads a node. Errors: kRefused if a value is wrong.
Result<EntryNode> entry_of_node(const nlohmann::json& node, const Lattice& lattice);

/// The plane (AssetSlice::T_lps_plane) of an entry whose vertices have the third coordinate z_mm.
/// This is the product frame * transform * (translation by z_mm along z), where `transform` is that
/// of the entry's node.
Eigen::Affine3d plane_of(const Eigen::Affine3d& frame, const Eigen::Affine3d& transform,
                         double z_mm);
/// The coordinate of a plane's origin (LPS, mm) along the plane's own normal.
double z_of_plane(const Eigen::Affine3d& T_lps_plane);

/// Makes the AssetSlice of an entry, except its geometry. `index` is AssetSlice::index, and z_mm
/// the height of the vertices. Errors: kRefused if the plane is not finite, or if the node has no
/// entry with this index.
Result<AssetSlice> slice_of_entry(const EntryNode& node, int index, int material,
                                  const Eigen::Affine3d& frame, double z_mm);

/// Properties of a decoded payload for which AssetSlice has no member.
struct PayloadFacts {
  std::int32_t z = 0;  ///< height of all vertices, steps
  bool has_colours = false;
};
/// Decodes a payload into the mesh and the HU of `slice`, and sets the outline of
/// `slice` to the boundary of the mesh. Errors: kRefused if the payload does not decode, or has no
/// triangles.
Result<PayloadFacts> decode_slice_geometry(std::span<const std::uint8_t> draco, AssetSlice& slice);
/// Compares a decoded slice with what the JSON states. Errors: kRefused if the number of vertices or
/// of triangles, the box around the vertices, or the presence of HU differs.
Result<void> compare_geometry(const StatedEntry& stated, const AssetSlice& slice);
/// A file may, for viewers, hold the outline of each slice, in addition to its mesh, as a glTF
/// primitive of lines. Compares the lines of an entry, in the file's binary data, with the outline
/// of the decoded `slice`. Errors: kRefused if they differ, or if the lines have another height than
/// stated.z.
Result<void> compare_lines(const StatedEntry& stated, std::span<const std::uint8_t> binary,
                           const AssetSlice& slice);

// Encodes a surface for display as a Draco payload, and decodes it. The payload keeps the lattice
// coordinates exactly and has a normal for each vertex. Internal to formats/.

/// Ids of the attributes in the Draco payload.
inline constexpr std::uint32_t kDracoSurfacePositionId = 0, kDracoSurfaceNormalId = 1;

/// Encodes a surface. Positions are stored in lattice steps. Normals are for shading only and are
/// quantised to 8 bits. Errors: kBug if check_triangle_surface() refuses the surface; kRefused if
/// the surface extends over more than 2^24 - 1 lattice steps.
Result<std::vector<std::uint8_t>> encode_surface(const TriangleSurface& surface);

/// Decodes a payload of encode_surface(), but not its normals. Vertices and triangles are in
/// Draco's order. Whether the surface is valid is not checked: call check_triangle_surface().
/// Errors: kRefused if the bytes are corrupted, if bytes follow the mesh, if the payload does not
/// have `vertices` vertices and `triangles` triangles (the numbers in the file's JSON), if a
/// coordinate is off the lattice or out of range, or if an index is out of range. Messages do not contain the file's name.
Result<TriangleSurface> decode_surface(std::span<const std::uint8_t> bytes, std::uint64_t vertices,
                                       std::uint64_t triangles, const Lattice& lattice);

/// The matrix of a surface's node, column by column. It maps lattice steps in the patient's frame
/// (LPS) to glTF's frame (metres, +Y up).
std::array<double, 16> surface_matrix(const Lattice& lattice);

// Writes volumes of HU into an asset file, and reads them. The JSON has one element of the array
// `extras.trocar.hu_volumes` for each volume. The bytes of a volume are a buffer view, which begins
// with a directory: one record for each plane. Internal to formats/. asset.md has the layout.

/// The location of a volume in the file, according to the document's extras.
struct HuSection {
  HuGrid grid;
  std::uint32_t view = 0;               ///< number of the buffer view
  std::uint64_t offset = 0, bytes = 0;  ///< location of the view in the binary chunk's data
  std::uint32_t planes = 0;             ///< number of planes
};

/// Appends a volume's buffer view, and returns the volume's element of `hu_volumes`. Precondition:
/// the planes ascend by index.
nlohmann::json add_hu_volume(GltfWriter& gltf, const EncodedHuVolume& volume);

/// Returns the volumes that `ours`, a document's `extras.trocar`, describes: at most one volume of
/// the material with a margin, and at most one of everything. Errors: kRefused if a volume has an
/// unknown version or a number out of range, or if two volumes are of the same kind.
Result<std::vector<HuSection>> hu_sections(const nlohmann::json& ours, const Lattice& lattice);

/// Decodes planes of HU into asset.hu and, if `with_context` is set, also into asset.context.
/// Decodes only the planes of the slices in asset.slices. A slice without outlines gets no plane in
/// asset.hu. The binary chunk's data begin at offset `binary_at` of `source` and have
/// `binary_bytes` bytes. For each slice only the bytes of its planes and O(log planes) records of
/// the directory are read. Errors: kRefused if bytes are damaged or lie outside the binary chunk,
/// or if there are more samples than max_hu_samples() (hu_codec.h).
Result<void> read_hu_volumes(ByteSource& source, std::uint64_t binary_at,
                             std::uint64_t binary_bytes, const std::vector<HuSection>& sections,
                             bool with_context, Asset& asset);

/// Checks a whole directory. `is_whole`: the asset has the outlines of all its slices. Errors:
/// kRefused if the planes do not ascend by index, do not fill the buffer view, or belong to slices
/// that the asset does not have. If `is_whole` is set and the volume has a margin, also kRefused if
/// a plane has bytes but its slice has no outline: no reader would read these bytes.
Result<void> check_hu_directory(ByteSource& source, std::uint64_t binary_at,
                                const HuSection& section, bool is_whole, const Asset& asset);

}  // namespace trocar
