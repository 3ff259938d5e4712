// SPDX-License-Identifier: Apache-2.0
// The geometry of slices as the JSON of a file describes it, before any payload is decoded.
// Internal to formats/; includes tinygltf (see gltf_document.h).
#pragma once
#include <cstdint>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/gltf_document.h"

namespace trocar {

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

}  // namespace trocar
