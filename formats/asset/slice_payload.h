// SPDX-License-Identifier: Apache-2.0
// Decodes a slice from the JSON of its node and from its bytes. This is used for reading a
// complete file (asset_decode.cpp) and for reading some of its slices (asset_part.cpp).
// Internal to formats/.
// Tests: tests/formats/asset/asset_part_test.cpp
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"

namespace trocar {

// Schema 2 has three nodes above those of the entries. Node 0 maps LPS in lattice steps to glTF's
// metres. Its only child is the frame, which all slices share. The frame's only child is the list,
// whose children are the nodes of the entries. The frame is a separate node so that its text, which
// every partial read needs, does not depend on the number of entries.
inline constexpr std::size_t kFrameNode = 1, kListNode = 2, kFirstEntryNode = 3;
/// The largest number of entries of one node. It limits the length of the text that is read
/// for one entry.
inline constexpr std::size_t kMaxNodeEntries = 32;

/// Parses JSON text from a file. Errors: (refused) it does not parse or is nested too deeply.
Result<nlohmann::json> parse_json_text(std::span<const std::uint8_t> text);

/// The object `trocar` of an element's extras, or null.
nlohmann::json trocar_extras(const nlohmann::json& extras);

/// Reads the document's extras, which describe the whole asset, into `asset`. Returns the number of
/// slices that they state. Errors: (refused) with `name` if they are not an asset's.
Result<std::size_t> read_document_extras(const nlohmann::json& extras, Asset& asset,
                                         const std::string& name);

/// The slice of a node of schema 1, without its geometry.
Result<AssetSlice> slice_of_node_1(const nlohmann::json& node);

/// The transform in a node's `translation` or `matrix`, converted from lattice steps to mm; the
/// identity if it has neither. Errors: (refused) it has both, or numbers are not finite.
Result<Eigen::Affine3d> transform_of_node(const nlohmann::json& node, const Lattice& lattice);

/// The JSON of a node of entries in schema 2. Their indices ascend by 1.
struct EntryNode {
  std::optional<int>
      index;  ///< index of the first entry; absent: one more than the previous entry's
  std::optional<double> z_mm;   ///< AssetSlice::z_mm; absent: z_of_plane()
  std::vector<double> mean_hu;  ///< one for each entry, or empty
  Eigen::Affine3d transform = Eigen::Affine3d::Identity();  ///< mm
};
Result<EntryNode> entry_of_node(const nlohmann::json& node, const Lattice& lattice);

/// The plane of an entry whose vertices are at z_mm: frame * (its node's transform) * z.
Eigen::Affine3d plane_of(const Eigen::Affine3d& frame, const Eigen::Affine3d& transform,
                         double z_mm);
/// The position of a plane's origin along its own normal.
double z_of_plane(const Eigen::Affine3d& T_lps_plane);

/// The slice of an entry, without its geometry. Errors: (refused) its plane is not finite, or the
/// node has no entry with this index.
Result<AssetSlice> slice_of_entry(const EntryNode& node, int index, int material,
                                  const Eigen::Affine3d& frame, double z_mm);

struct GeometryBytes {
  std::span<const std::uint8_t> draco, outline, segments;
};
/// Decodes mesh and outline of a record of schema 1 that has triangles. `bytes` have the sizes that
/// the record states. Errors: (refused) counts or box differ from the record.
Result<void> decode_slice_geometry_1(const SliceRecord& record, const GeometryBytes& bytes,
                                     const Lattice& lattice, AssetSlice& slice);

/// Facts about a payload that AssetSlice does not contain.
struct PayloadFacts {
  std::int32_t z = 0;  ///< height of all vertices, steps
  bool has_colours = false;
};
/// Decodes mesh and HU of a payload of schema 2, and derives the outline from the mesh.
Result<PayloadFacts> decode_slice_geometry(std::span<const std::uint8_t> draco, AssetSlice& slice);
/// Errors: (refused) the payload's counts, box or HU differ from those that the JSON states.
Result<void> compare_geometry(const SliceRecord& stated, bool has_hu, const AssetSlice& slice);
/// Errors: (refused) the lines are not the slice's outline at a height of z steps.
Result<void> compare_lines(const SliceRecord& record, const GeometryBytes& bytes, std::int32_t z,
                           const AssetSlice& slice);

}  // namespace trocar
