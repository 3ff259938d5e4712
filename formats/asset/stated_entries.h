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

/// One entry: its record without the offset of its node's text and without the checksum.
struct StatedEntry {
  SliceRecord record;
  bool has_hu = false, has_colours = false, has_lines = false;
  std::int32_t z = 0;  ///< height of all vertices, steps
};
/// The entries of a node whose first entry has the slice index `first_index`. If the node has no
/// mesh, there is a single entry without geometry. Otherwise there is one for each primitive of
/// triangles, which may be followed by a primitive of lines. Errors: (refused, with the slice) the
/// primitives are not those of an asset.
Result<std::vector<StatedEntry>> stated_entries(const tinygltf::Model& model,
                                                const tinygltf::Node& node, int first_index,
                                                const Asset& asset);
/// The number of entries of all these nodes, without any check.
std::size_t count_entries(const tinygltf::Model& model, const std::vector<int>& nodes);

}  // namespace trocar
