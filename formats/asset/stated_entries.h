// SPDX-License-Identifier: Apache-2.0
// The geometry of slices as the JSON of a file describes it, before any payload is decoded.
// Internal to formats/; includes tinygltf (see gltf_document.h).
// Tests: tests/formats/asset/asset_test.cpp
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
  SliceRecord record;
  bool has_hu = false, has_colours = false, has_lines = false;
  std::int32_t z = 0;  ///< height of all vertices, steps
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
