// SPDX-License-Identifier: Apache-2.0
// Decodes a slice of an asset. Two parts of the file describe the slice: its glTF node, which is
// JSON text, and its payload, which is its mesh as Draco has compressed it (draco_mesh.h).
// asset_decode.cpp, which reads complete files, and asset_part.cpp, which reads some slices, both
// use these functions. Internal to formats/.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"

namespace trocar {

struct StatedEntry;  // stated_entries.h

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

}  // namespace trocar
