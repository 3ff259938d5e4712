// SPDX-License-Identifier: Apache-2.0
// Decodes a slice from its parts in the file: the JSON of its node, and its bytes. Used both for
// reading a whole file (asset_decode.cpp) and some slices of it (asset_part.cpp). Internal to
// formats/.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"

namespace trocar {

// The nodes above those of the entries, in schema 2: node 0, LPS in lattice steps to glTF's metres;
// its only child, the frame, which all slices share; its only child, whose children are the
// nodes of the entries. The frame's text does not depend on the number of entries, and is read for
// each part.
inline constexpr std::size_t kFrameNode = 1, kListNode = 2, kFirstEntryNode = 3;
/// A node holds so many entries at most, so that the text to be read for one of them is short.
inline constexpr std::size_t kMaxNodeEntries = 32;

/// JSON text from a file; refused if it does not parse or is nested too deeply (recursion).
Result<nlohmann::json> parse_json_text(std::span<const std::uint8_t> text);

/// The `trocar` object of an element's extras, or null.
nlohmann::json trocar_extras(const nlohmann::json& extras);

/// Reads what the document's extras say of the whole asset into `asset`; gives the number of slices
/// that they state, each counted once. Refused, with `name`, if they are not an asset's.
Result<std::size_t> read_document_extras(const nlohmann::json& extras, Asset& asset,
                                         const std::string& name);

/// The slice without its geometry, from its node in schema 1.
Result<AssetSlice> slice_of_node_1(const nlohmann::json& node);

/// What a node's `translation` or `matrix` says, in mm (the file has lattice steps); the identity
/// without either. Refused if it has both or its numbers are not finite.
Result<Eigen::Affine3d> transform_of_node(const nlohmann::json& node, const Lattice& lattice);

/// What a node of entries says in schema 2. Their indices ascend by 1.
struct EntryNode {
  std::optional<int> index;     ///< of the first; absent: that of the entry before, plus 1
  std::optional<double> z_mm;   ///< absent: z_of_plane()
  std::vector<double> mean_hu;  ///< of each; or empty
  Eigen::Affine3d transform = Eigen::Affine3d::Identity();  ///< mm
};
Result<EntryNode> entry_of_node(const nlohmann::json& node, const Lattice& lattice);

/// The plane of an entry whose vertices are at z_mm: frame * (its node's transform) * z.
Eigen::Affine3d plane_of(const Eigen::Affine3d& frame, const Eigen::Affine3d& transform,
                         double z_mm);
/// Of a plane's origin, along its own normal.
double z_of_plane(const Eigen::Affine3d& T_lps_plane);

/// The slice of an entry, without its geometry. Refused if its plane is not finite, or its index
/// not one of the node's.
Result<AssetSlice> slice_of_entry(const EntryNode& node, int index, int material,
                                  const Eigen::Affine3d& frame, double z_mm);

struct GeometryBytes {
  std::span<const std::uint8_t> draco, outline, segments;
};
/// Decodes mesh and outline of a record of schema 1 that has triangles; refused if they differ from
/// its counts or its box. `bytes` have the sizes that the record states.
Result<void> decode_slice_geometry_1(const SliceRecord& record, const GeometryBytes& bytes,
                                     const Lattice& lattice, AssetSlice& slice);

/// What a payload says beside its slice.
struct PayloadFacts {
  std::int32_t z = 0;  ///< of the vertices, steps
  bool has_colours = false;
};
/// Decodes mesh and HU of a payload of schema 2, and the outline from them.
Result<PayloadFacts> decode_slice_geometry(std::span<const std::uint8_t> draco, AssetSlice& slice);
/// Refused if the payload's counts, box or HU differ from what the JSON states.
Result<void> compare_geometry(const SliceRecord& stated, bool has_hu, const AssetSlice& slice);
/// Refused if the lines are not the slice's outline, at z steps.
Result<void> compare_lines(const SliceRecord& record, const GeometryBytes& bytes, std::int32_t z,
                           const AssetSlice& slice);

}  // namespace trocar
