// SPDX-License-Identifier: Apache-2.0
// The glTF document of an asset as tinygltf reads it, and checked access to the document's
// accessors and buffer views. Internal to formats/; includes tinygltf. Debian's libdraco exports a
// second tinygltf, built with other options. To keep the two apart, every file that includes this
// header is compiled with hidden visibility (formats/CMakeLists.txt).
#pragma once

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE

// json.hpp must be included before tiny_gltf.h. Otherwise tiny_gltf.h includes it with hidden
// visibility. The system headers that json.hpp includes would then get hidden visibility, too, and
// so would functions of the C library such as close().
#include <nlohmann/json.hpp>

#include <tiny_gltf.h>

#include <cstdint>
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
/// Parses the container of a .glb. Errors: kRefused if the container is broken, is not valid glTF,
/// has more than one buffer, or has a buffer with a URI. Messages begin with `name`.
Result<GltfDocument> parse_gltf(std::span<const std::uint8_t> glb, const std::string& name);

/// The element of a list with this index, or null.
template <typename Element>
const Element* element_at(const std::vector<Element>& list, int index) {
  const auto at = static_cast<std::size_t>(index);
  return index >= 0 && at < list.size() ? &list[at] : nullptr;
}

/// The bytes of a buffer view, or std::nullopt if the view does not exist, has a stride, or does
/// not lie in the buffer.
std::optional<std::span<const std::uint8_t>> view_bytes(const tinygltf::Model& model, int view);
/// The accessor of the attribute `name` of a primitive, or null.
const tinygltf::Accessor* attribute_of(const tinygltf::Model& model,
                                       const tinygltf::Primitive& primitive, const char* name);
/// The number of the buffer view of an accessor, if the view consists of exactly the accessor's
/// elements without gaps. Otherwise std::nullopt.
std::optional<int> packed_view(const tinygltf::Model& model, const tinygltf::Accessor& accessor,
                               std::size_t element_bytes);
/// Offset of a view in the buffer. Precondition: the view exists.
std::uint32_t offset_of(const tinygltf::Model& model, int view);

/// A primitive whose triangles are in a Draco payload, as the JSON describes the primitive.
struct DracoPrimitive {
  const tinygltf::Accessor* position = nullptr;
  std::uint32_t vertices = 0, triangles = 0, offset = 0;  ///< offset of the payload in the buffer
  std::span<const std::uint8_t> payload = {};
};
/// Finds the payload of a primitive. Errors: kRefused if there is no payload, if the payload is
/// outside the buffer, or if the number of vertices or triangles is impossible.
Result<DracoPrimitive> draco_primitive(const tinygltf::Model& model,
                                       const tinygltf::Primitive& primitive);
/// The Draco id of an attribute; -1 if the primitive's Draco extension does not name the attribute.
int draco_id(const tinygltf::Primitive& primitive, const char* attribute);

/// Numbers of the nodes whose extras describe a surface for display. Such nodes are top-level nodes
/// of the glTF scene, like node 0, below which all slices are.
std::vector<std::size_t> surface_nodes(const GltfDocument& document);

}  // namespace trocar
