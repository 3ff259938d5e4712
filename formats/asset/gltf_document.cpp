// SPDX-License-Identifier: Apache-2.0
#define TINYGLTF_IMPLEMENTATION
#include "formats/asset/gltf_document.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "formats/asset/asset_index.h"
#include "formats/asset/draco_mesh.h"
#include "formats/asset/payload.h"
#include "formats/base/files.h"
#include "formats/base/json.h"

namespace trocar {
namespace {

constexpr const char* kIndicesSetAside = "trocar_indices";

// File functions that open nothing, so that an asset cannot name a file that would be read. A template, because only newer
// releases of tinygltf (2.9) have a function for a file's size.
template <typename Callbacks>
Callbacks no_files() {
  Callbacks none{};
  none.FileExists = [](const std::string&, void*) { return false; };
  none.ExpandFilePath = [](const std::string& path, void*) { return path; };
  none.ReadWholeFile = [](std::vector<unsigned char>*, std::string* error, const std::string&,
                          void*) {
    *error += "external files are not read";
    return false;
  };
  none.WriteWholeFile = [](std::string*, const std::string&, const std::vector<unsigned char>&,
                           void*) { return false; };
  if constexpr (requires { none.GetFileSizeInBytes; })
    none.GetFileSizeInBytes = [](std::size_t*, std::string*, const std::string&, void*) {
      return false;
    };
  return none;
}

// tinygltf 2.7 refuses a primitive whose index accessor has no buffer view, although this is how
// glTF says that the indices are in the Draco payload. This moves the number of such an accessor
// into the Draco extension, where draco_primitive() finds it.
std::vector<std::uint8_t> with_indices_set_aside(std::span<const std::uint8_t> glb,
                                                 std::size_t json_size, nlohmann::json& root) {
  static const nlohmann::json::json_pointer kDraco(std::string("/extensions/") + kDracoExtension);
  if (root.contains("meshes") && root["meshes"].is_array()) {
    for (nlohmann::json& mesh : root["meshes"]) {
      if (!mesh.contains("primitives") || !mesh["primitives"].is_array()) continue;
      for (nlohmann::json& primitive : mesh["primitives"]) {
        if (!primitive.contains("indices") || !primitive.contains(kDraco) ||
            !primitive[kDraco].is_object())
          continue;
        primitive[kDraco][kIndicesSetAside] = primitive["indices"];
        primitive.erase("indices");
      }
    }
  }
  std::string out = json_text(root);
  out.resize((out.size() + 3) & ~std::size_t{3}, ' ');
  std::vector<std::uint8_t> bytes;
  // The exact size, so that the address sanitizer detects a read beyond the end.
  bytes.reserve(out.size() + glb.size() - json_size);
  bytes.insert(bytes.end(), glb.begin(), glb.begin() + kGlbHeader);
  bytes.insert(bytes.end(), out.begin(), out.end());
  bytes.insert(bytes.end(), glb.begin() + static_cast<std::ptrdiff_t>(kGlbHeader + json_size),
               glb.end());
  const auto total = static_cast<std::uint32_t>(bytes.size()),
             chunk = static_cast<std::uint32_t>(out.size());
  std::memcpy(bytes.data() + 8, &total, 4);
  std::memcpy(bytes.data() + 12, &chunk, 4);
  return bytes;
}

// An integer member of the primitive's Draco extension; -1 if it is missing.
int draco_member(const tinygltf::Primitive& primitive, const char* key) {
  const auto it = primitive.extensions.find(kDracoExtension);
  const bool is_there = it != primitive.extensions.end() && it->second.IsObject() &&
                        it->second.Has(key) && it->second.Get(key).IsInt();
  return is_there ? it->second.Get(key).Get<int>() : -1;
}

}  // namespace

Result<GltfDocument> parse_gltf(std::span<const std::uint8_t> glb, const std::string& name) {
  // tinygltf is only safe if sizes add up and JSON is not nested deeply.
  MemorySource source(glb);
  const auto json_bytes = json_bytes_of(source);
  if (!json_bytes) return refused(name + ": " + json_bytes.error().message);
  // tinygltf accepts a binary chunk that ends up to eight bytes behind the file.
  if (const auto rest = glb.subspan(kGlbHeader + *json_bytes); !rest.empty()) {
    std::uint32_t binary_bytes = 0;
    if (rest.size() >= kGlbChunkHeader)
      std::memcpy(&binary_bytes, rest.data(), sizeof binary_bytes);
    if (rest.size() < kGlbChunkHeader || binary_bytes > rest.size() - kGlbChunkHeader)
      return refused(name + ": broken binary chunk");
  }
  auto root = parse_json_text(glb.subspan(kGlbHeader, *json_bytes));
  if (!root) return refused(name + ": " + root.error().message);
  if (!root->is_object()) return refused(name + ": its JSON is not an object");
  const auto patched = with_indices_set_aside(glb, *json_bytes, *root);
  GltfDocument document;
  document.extras = std::move((*root)["extras"]);
  document.nodes = std::move((*root)["nodes"]);
  root = nlohmann::json();
  tinygltf::TinyGLTF gltf;
  gltf.SetFsCallbacks(no_files<tinygltf::FsCallbacks>());
  tinygltf::Model& model = document.model;
  std::string error, warning;
  bool ok = false;
  try {
    ok = gltf.LoadBinaryFromMemory(&model, &error, &warning, patched.data(),
                                   static_cast<unsigned>(patched.size()));
  } catch (const std::exception& e) {
    error = e.what();
  }
  if (!ok) {
    std::replace(error.begin(), error.end(), '\n', ' ');
    return refused(name + ": not readable as glTF: " + error);
  }
  if (model.buffers.size() > 1 || (model.buffers.size() == 1 && !model.buffers[0].uri.empty()))
    return refused(name + ": an asset has one embedded buffer");
  return document;
}

std::optional<std::span<const std::uint8_t>> view_bytes(const tinygltf::Model& model, int view) {
  const tinygltf::BufferView* const v = element_at(model.bufferViews, view);
  if (v == nullptr || v->buffer != 0 || model.buffers.empty() || v->byteStride != 0)
    return std::nullopt;
  const std::vector<unsigned char>& bytes = model.buffers[0].data;
  if (v->byteOffset > bytes.size() || v->byteLength > bytes.size() - v->byteOffset)
    return std::nullopt;
  return std::span(bytes.data() + v->byteOffset, v->byteLength);
}

const tinygltf::Accessor* attribute_of(const tinygltf::Model& model,
                                       const tinygltf::Primitive& primitive, const char* name) {
  const auto it = primitive.attributes.find(name);
  return it == primitive.attributes.end() ? nullptr : element_at(model.accessors, it->second);
}

std::optional<int> packed_view(const tinygltf::Model& model, const tinygltf::Accessor& accessor,
                               std::size_t element_bytes) {
  const auto bytes = view_bytes(model, accessor.bufferView);
  if (!bytes || accessor.byteOffset != 0 || accessor.sparse.isSparse) return std::nullopt;
  if (accessor.count > bytes->size() || accessor.count * element_bytes != bytes->size())
    return std::nullopt;
  return accessor.bufferView;
}

std::uint32_t offset_of(const tinygltf::Model& model, int view) {
  return static_cast<std::uint32_t>(model.bufferViews[static_cast<std::size_t>(view)].byteOffset);
}

Result<DracoPrimitive> draco_primitive(const tinygltf::Model& model,
                                       const tinygltf::Primitive& primitive) {
  DracoPrimitive out{.position = attribute_of(model, primitive, "POSITION")};
  const tinygltf::Accessor* indices =
      element_at(model.accessors, draco_member(primitive, kIndicesSetAside));
  if (out.position == nullptr || indices == nullptr)
    return refused("triangles without a Draco payload");
  constexpr std::size_t kMax = std::numeric_limits<std::uint32_t>::max();
  if (out.position->count > kMax || indices->count > kMax || indices->count % 3 != 0 ||
      indices->count == 0)
    return refused("triangles of an impossible count");
  const int view = draco_member(primitive, "bufferView");
  const auto payload = view_bytes(model, view);
  if (!payload || payload->empty()) return refused("Draco payload outside the buffer");
  out.vertices = static_cast<std::uint32_t>(out.position->count);
  out.triangles = static_cast<std::uint32_t>(indices->count / 3);
  out.offset = offset_of(model, view);
  out.payload = *payload;
  return out;
}

int draco_id(const tinygltf::Primitive& primitive, const char* attribute) {
  const auto it = primitive.extensions.find(kDracoExtension);
  if (it == primitive.extensions.end() || !it->second.Has("attributes")) return -1;
  const tinygltf::Value& ids = it->second.Get("attributes");
  return ids.Has(attribute) && ids.Get(attribute).IsInt() ? ids.Get(attribute).Get<int>() : -1;
}

std::vector<std::size_t> surface_nodes(const GltfDocument& document) {
  const auto& [extras, nodes, model] = document;
  std::vector<std::size_t> out;
  if (model.scenes.empty()) return out;
  static const nlohmann::json::json_pointer kSurface("/extras/trocar/surface");
  for (const int node : model.scenes[0].nodes) {
    if (node <= 0 || static_cast<std::size_t>(node) >= std::min(model.nodes.size(), nodes.size()))
      continue;
    const auto at = static_cast<std::size_t>(node);
    if (nodes[at].contains(kSurface)) out.push_back(at);
  }
  return out;
}

}  // namespace trocar
