// SPDX-License-Identifier: Apache-2.0
// An asset's container as tinygltf reads it, and checked access to its accessors and buffer views.
// Internal to formats/; includes tinygltf. Debian's libdraco exports a tinygltf built with other options; to keep the
// two apart, every file that includes this one is compiled with hidden visibility.
// Tests: tests/formats/asset/asset_test.cpp
#pragma once

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#include <tiny_gltf.h>

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar {

struct GltfDocument {
  nlohmann::json extras, nodes;  ///< the document's extras and the array of nodes, as JSON
  tinygltf::Model model;
};
/// Parses the container. Errors: (refused, with `name`) a broken container, invalid glTF, or
/// anything but one embedded buffer.
Result<GltfDocument> parse_gltf(std::span<const std::uint8_t> glb, const std::string& name);

/// The bytes of a buffer view; none if any number is out of range.
std::optional<std::span<const std::uint8_t>> view_bytes(const tinygltf::Model& model, int view);
/// The accessor with this index, or null.
const tinygltf::Accessor* accessor_at(const tinygltf::Model& model, int index);
/// The accessor of this attribute, or null.
const tinygltf::Accessor* attribute_of(const tinygltf::Model& model,
                                       const tinygltf::Primitive& primitive, const char* name);
/// The number of an accessor's view if the view holds exactly its elements, packed; otherwise none.
std::optional<int> packed_view(const tinygltf::Model& model, const tinygltf::Accessor& accessor,
                               std::size_t element_bytes);
/// Start of a valid view in the buffer.
std::uint32_t offset_of(const tinygltf::Model& model, int view);

/// Triangles in a Draco payload, as the JSON describes them.
struct DracoPrimitive {
  const tinygltf::Accessor* position = nullptr;
  std::uint32_t vertices = 0, triangles = 0, offset = 0;
  std::span<const std::uint8_t> payload = {};
};
/// Errors: (refused) there is no payload, it is outside the buffer, or a count is impossible.
Result<DracoPrimitive> draco_primitive(const tinygltf::Model& model,
                                       const tinygltf::Primitive& primitive);
/// The Draco id of an attribute; -1 if the primitive's extension does not name it.
int draco_id(const tinygltf::Primitive& primitive, const char* attribute);

/// Numbers of the nodes outside the scan's node whose extras describe a surface for display.
std::vector<std::size_t> surface_nodes(const GltfDocument& document);

}  // namespace trocar
