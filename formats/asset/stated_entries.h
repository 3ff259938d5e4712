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

/// An entry (one material of one slice) as the JSON describes it. `record` lacks the offset of the
/// node's text and the checksum.
struct StatedEntry {
  SliceRecord record;
  bool has_hu = false, has_colours = false, has_lines = false;
  std::int32_t z = 0;  ///< height of all vertices, steps
};
/// Returns the entries of a node. The first entry gets the slice index `first_index`, and each
/// further entry the next index. If the node has no mesh, there is a single entry without
/// geometry. Otherwise there is one entry for each primitive of triangles; a primitive of lines
/// may follow each of them. Errors: kRefused if the primitives are not those of an asset; the
/// message has the slice.
Result<std::vector<StatedEntry>> stated_entries(const tinygltf::Model& model,
                                                const tinygltf::Node& node, int first_index,
                                                const Asset& asset);
/// Counts the entries of all these nodes, without checking them.
std::size_t count_entries(const tinygltf::Model& model, const std::vector<int>& nodes);

}  // namespace trocar
