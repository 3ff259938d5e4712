// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <utility>

#include "formats/asset.h"
#include "formats/draco_mesh.h"
#include "formats/file_io.h"
#include "formats/gltf.h"
#include "formats/mesh_validity.h"

namespace trocar {
namespace {

constexpr const char* kIndicesSetAside = "trocar_indices";
constexpr int kMaxJsonDepth = 64;
constexpr std::size_t kMaxSlices = 100'000;

// The `trocar` object of some extras, or null.
nlohmann::json our_extras(const tinygltf::Value& extras) {
  return extras.IsObject() && extras.Has("trocar") ? to_json(extras.Get("trocar")) : nullptr;
}

// The smallest structure that tinygltf needs to be safe: one JSON chunk, not
// nested deeply (its value type recurses), sizes that add up.
Result<void> check_container(std::span<const std::uint8_t> glb, const std::string& name) {
  const auto u32 = [&](std::size_t at) {
    std::uint32_t v = 0;
    std::memcpy(&v, glb.data() + at, 4);
    return v;
  };
  if (glb.size() < 20 || u32(0) != 0x46546C67 || u32(4) != 2) {
    return refused(name + ": not a binary glTF 2.0 file");
  }
  if (u32(8) != glb.size())
    return refused(name + ": its length field says " + std::to_string(u32(8)) +
                   " bytes, the file has " + std::to_string(glb.size()));
  const std::uint64_t json_size = u32(12);
  if (u32(16) != 0x4E4F534A || 20 + json_size > glb.size()) {
    return refused(name + ": broken JSON chunk");
  }
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 20; i < 20 + json_size; ++i) {
    const std::uint8_t c = glb[i];
    if (in_string) {
      if (c == '\\') ++i;
      in_string = c != '"';
    } else if (c == '"') {
      in_string = true;
    } else if (c == '{' || c == '[') {
      if (++depth > kMaxJsonDepth) return refused(name + ": JSON nested too deeply");
    } else if (c == '}' || c == ']') {
      --depth;
    }
  }
  return {};
}

// tinygltf 2.7 refuses a primitive whose index accessor has no buffer view, which is how glTF says
// that the indices are in the Draco payload. Moves such an index accessor's number into the Draco
// extension, where decode_triangles() looks for it.
Result<std::vector<std::uint8_t>> with_indices_set_aside(std::span<const std::uint8_t> glb,
                                                         const std::string& name) {
  std::uint32_t json_size = 0;
  std::memcpy(&json_size, glb.data() + 12, 4);
  const auto text = glb.subspan(20, json_size);
  nlohmann::json root = nlohmann::json::parse(text.begin(), text.end(), nullptr, false);
  if (!root.is_object()) return refused(name + ": its JSON does not parse");
  if (root.contains("meshes") && root["meshes"].is_array()) {
    for (nlohmann::json& mesh : root["meshes"]) {
      if (!mesh.is_object() || !mesh.contains("primitives") || !mesh["primitives"].is_array())
        continue;
      for (nlohmann::json& primitive : mesh["primitives"]) {
        if (!primitive.is_object() || !primitive.contains("indices")) continue;
        if (!primitive.contains("extensions") || !primitive["extensions"].is_object()) continue;
        nlohmann::json& extensions = primitive["extensions"];
        if (!extensions.contains(kDracoExtension) || !extensions[kDracoExtension].is_object())
          continue;
        extensions[kDracoExtension][kIndicesSetAside] = primitive["indices"];
        primitive.erase("indices");
      }
    }
  }
  std::string out;
  try {
    out = root.dump();
  } catch (const nlohmann::json::exception&) {
    return refused(name + ": its JSON is not UTF-8");
  }
  out.resize((out.size() + 3) & ~std::size_t{3}, ' ');
  std::vector<std::uint8_t> bytes(glb.begin(), glb.begin() + 20);
  bytes.insert(bytes.end(), out.begin(), out.end());
  bytes.insert(bytes.end(), glb.begin() + 20 + json_size, glb.end());
  const auto total = static_cast<std::uint32_t>(bytes.size()),
             chunk = static_cast<std::uint32_t>(out.size());
  std::memcpy(bytes.data() + 8, &total, 4);
  std::memcpy(bytes.data() + 12, &chunk, 4);
  return bytes;
}

Result<tinygltf::Model> parse_container(std::span<const std::uint8_t> glb,
                                        const std::string& name) {
  if (auto ok = check_container(glb, name); !ok) return ok.error();
  const auto patched = with_indices_set_aside(glb, name);
  if (!patched) return patched.error();
  tinygltf::TinyGLTF gltf;
  gltf.SetFsCallbacks(
      {[](const std::string&, void*) { return false; },
       [](const std::string& path, void*) { return path; },
       [](std::vector<unsigned char>*, std::string* err, const std::string&, void*) {
         *err += "external files are not read";
         return false;
       },
       [](std::string*, const std::string&, const std::vector<unsigned char>&, void*) {
         return false;
       },
       nullptr});
  tinygltf::Model model;
  std::string error, warning;
  bool ok = false;
  try {
    ok = gltf.LoadBinaryFromMemory(&model, &error, &warning, patched->data(),
                                   static_cast<unsigned>(patched->size()));
  } catch (const std::exception& e) {
    error = e.what();
  }
  if (!ok) {
    std::replace(error.begin(), error.end(), '\n', ' ');
    return refused(name + ": not readable as glTF: " + error);
  }
  if (model.buffers.size() > 1 || (model.buffers.size() == 1 && !model.buffers[0].uri.empty())) {
    return refused(name + ": an asset has one embedded buffer");
  }
  return model;
}

// The bytes of a buffer view, or nothing if any number is out of range.
std::optional<std::span<const std::uint8_t>> view_bytes(const tinygltf::Model& model, int view) {
  if (view < 0 || static_cast<std::size_t>(view) >= model.bufferViews.size()) return std::nullopt;
  const tinygltf::BufferView& v = model.bufferViews[static_cast<std::size_t>(view)];
  if (v.buffer != 0 || model.buffers.empty() || v.byteStride != 0) return std::nullopt;
  const std::vector<unsigned char>& bytes = model.buffers[0].data;
  if (v.byteOffset > bytes.size() || v.byteLength > bytes.size() - v.byteOffset)
    return std::nullopt;
  return std::span(bytes.data() + v.byteOffset, v.byteLength);
}

const tinygltf::Accessor* accessor_at(const tinygltf::Model& model, int index) {
  if (index < 0 || static_cast<std::size_t>(index) >= model.accessors.size()) return nullptr;
  return &model.accessors[static_cast<std::size_t>(index)];
}

// The elements of a tightly packed accessor.
template <typename T>
std::optional<std::vector<T>> accessor_data(const tinygltf::Model& model,
                                            const tinygltf::Accessor& accessor, std::size_t width) {
  const auto bytes = view_bytes(model, accessor.bufferView);
  if (!bytes || accessor.byteOffset != 0 || accessor.sparse.isSparse) return std::nullopt;
  if (accessor.count > bytes->size() || accessor.count * width * sizeof(T) != bytes->size())
    return std::nullopt;
  std::vector<T> out(accessor.count * width);
  std::memcpy(out.data(), bytes->data(), bytes->size());
  return out;
}

int position_accessor(const tinygltf::Primitive& primitive) {
  const auto it = primitive.attributes.find("POSITION");
  return it == primitive.attributes.end() ? -1 : it->second;
}

Result<SliceMesh> decode_triangles(const tinygltf::Model& model,
                                   const tinygltf::Primitive& primitive, const Lattice& lattice) {
  const auto it = primitive.extensions.find(kDracoExtension);
  const tinygltf::Accessor* position = accessor_at(model, position_accessor(primitive));
  const auto number = [&](const char* key) {
    const bool there = it != primitive.extensions.end() && it->second.IsObject() &&
                       it->second.Has(key) && it->second.Get(key).IsInt();
    return there ? it->second.Get(key).Get<int>() : -1;
  };
  const tinygltf::Accessor* indices = accessor_at(model, number(kIndicesSetAside));
  if (position == nullptr || indices == nullptr) {
    return refused("triangles without a Draco payload");
  }
  const auto payload = view_bytes(model, number("bufferView"));
  if (!payload) return refused("Draco payload outside the buffer");
  auto mesh = decode_draco(*payload, lattice, position->count, indices->count / 3);
  if (!mesh) return mesh;
  if (mesh->vertices.size() != position->count || mesh->triangles.size() * 3 != indices->count) {
    return refused("Draco payload and accessor counts differ");
  }
  LatticePoint low = mesh->vertices.empty() ? LatticePoint{} : mesh->vertices.front(), high = low;
  for (LatticePoint p : mesh->vertices) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y)};
  }
  if (position->minValues != std::vector<double>{lattice.to_mm(low.x), lattice.to_mm(low.y), 0.0} ||
      position->maxValues !=
          std::vector<double>{lattice.to_mm(high.x), lattice.to_mm(high.y), 0.0}) {
    return refused("accessor bounds differ from the vertices");
  }
  return mesh;
}

Result<Pslg> decode_lines(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                          const Lattice& lattice) {
  const tinygltf::Accessor* position = accessor_at(model, position_accessor(primitive));
  const tinygltf::Accessor* index = accessor_at(model, primitive.indices);
  if (position == nullptr || index == nullptr ||
      position->componentType != TINYGLTF_COMPONENT_TYPE_FLOAT ||
      position->type != TINYGLTF_TYPE_VEC3 || index->type != TINYGLTF_TYPE_SCALAR) {
    return refused("outline without positions or indices");
  }
  const auto xyz = accessor_data<float>(model, *position, 3);
  std::vector<std::uint32_t> indices;
  if (index->componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT) {
    if (const auto narrow = accessor_data<std::uint16_t>(model, *index, 1)) {
      indices.assign(narrow->begin(), narrow->end());
    }
  } else if (index->componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT) {
    if (auto wide = accessor_data<std::uint32_t>(model, *index, 1)) indices = std::move(*wide);
  }
  if (!xyz || indices.size() != index->count || indices.size() != 2 * position->count) {
    return refused("outline data outside the buffer or of the wrong size");
  }
  // Rings as written: (f, f+1) (f+1, f+2) ... (l, f).
  Pslg pslg;
  Ring ring;
  std::size_t first = 0;
  for (std::size_t i = 0; i < position->count; ++i) {
    const double x = std::ldexp(static_cast<double>((*xyz)[3 * i]), lattice.bits);
    const double y = std::ldexp(static_cast<double>((*xyz)[3 * i + 1]), lattice.bits);
    if (!(std::abs(x) <= kMaxCoordinate && std::abs(y) <= kMaxCoordinate) || x != std::rint(x) ||
        y != std::rint(y) || (*xyz)[3 * i + 2] != 0.0F) {
      return refused("outline vertex " + std::to_string(i) + " is off the lattice");
    }
    ring.push_back({static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)});
    const std::uint32_t to = indices[2 * i + 1];
    if (indices[2 * i] != i || (to != i + 1 && to != first) || (to == first && ring.size() < 3)) {
      return refused("outline segment " + std::to_string(i) + " does not continue its ring");
    }
    if (to == first) {
      pslg.rings.push_back(std::exchange(ring, {}));
      first = i + 1;
    }
  }
  if (!ring.empty()) return refused("outline ring not closed");
  return pslg;
}

Result<AssetSlice> decode_slice(const tinygltf::Model& model, const tinygltf::Node& node,
                                const Lattice& lattice, const DecodeOptions& options) {
  const nlohmann::json extras = our_extras(node.extras);
  if (!extras.is_object() || !extras.contains("index") || !extras["index"].is_number_integer() ||
      !extras.contains("z_mm") || !extras["z_mm"].is_number()) {
    return refused("a slice node without index and z_mm");
  }
  AssetSlice slice;
  slice.index = extras["index"].get<int>();
  slice.z_mm = extras["z_mm"].get<double>();
  slice.measures = extras.value("measures", nlohmann::json::object());
  const std::string where = "slice " + std::to_string(slice.index) + ": ";
  if (node.matrix.size() != 16 || !std::all_of(node.matrix.begin(), node.matrix.end(),
                                               [](double d) { return std::isfinite(d); })) {
    return refused(where + "node without a finite matrix");
  }
  slice.T_lps_plane.matrix() = Eigen::Map<const Eigen::Matrix4d>(node.matrix.data());
  const bool wanted =
      options.all || std::find(options.slice_indices.begin(), options.slice_indices.end(),
                               slice.index) != options.slice_indices.end();
  if (node.mesh < 0 || !wanted) return slice;
  if (static_cast<std::size_t>(node.mesh) >= model.meshes.size()) {
    return refused(where + "mesh index out of range");
  }
  const tinygltf::Mesh& mesh = model.meshes[static_cast<std::size_t>(node.mesh)];
  if (mesh.primitives.size() != 2 || mesh.primitives[0].mode != TINYGLTF_MODE_TRIANGLES ||
      mesh.primitives[1].mode != TINYGLTF_MODE_LINE) {
    return refused(where + "expected one triangles and one lines primitive");
  }
  auto triangles = decode_triangles(model, mesh.primitives[0], lattice);
  if (!triangles) return refused(where + triangles.error().message);
  auto lines = decode_lines(model, mesh.primitives[1], lattice);
  if (!lines) return refused(where + lines.error().message);
  slice.mesh = std::move(*triangles);
  slice.pslg = std::move(*lines);
  return slice;
}

}  // namespace

Result<Asset> decode_asset(std::span<const std::uint8_t> glb, const std::string& name,
                           const DecodeOptions& options) {
  auto model = parse_container(glb, name);
  if (!model) return model.error();
  const nlohmann::json extras = our_extras(model->extras);
  if (!extras.is_object() || extras.value("schema", nlohmann::json()) != kAssetSchema) {
    return refused(name + ": not a Trocar asset of schema " + std::to_string(kAssetSchema));
  }
  const nlohmann::json bits = extras.value("lattice_bits", nlohmann::json());
  if (!bits.is_number_integer() || bits < kMinLatticeBits || bits > kMaxLatticeBits) {
    return refused(name + ": lattice_bits missing or out of range");
  }
  Asset asset;
  asset.lattice.bits = bits.get<int>();
  asset.generator = model->asset.generator;
  asset.parameters = extras.value("parameters", nlohmann::json::object());
  const nlohmann::json digest = extras.value("input_digest", nlohmann::json());
  if (digest.is_string()) asset.input_digest = digest.get<std::string>();

  if (model->nodes.empty() || model->nodes[0].children.size() > kMaxSlices) {
    return refused(name + ": no scan node, or too many slices");
  }
  for (int child : model->nodes[0].children) {
    if (child <= 0 || static_cast<std::size_t>(child) >= model->nodes.size()) {
      return refused(name + ": node index out of range");
    }
    auto slice =
        decode_slice(*model, model->nodes[static_cast<std::size_t>(child)], asset.lattice, options);
    if (!slice) return refused(name + ": " + slice.error().message);
    if (!asset.slices.empty() && asset.slices.back().index >= slice->index) {
      return refused(name + ": slice indices do not ascend");
    }
    asset.slices.push_back(std::move(*slice));
  }
  return asset;
}

Result<AssetSizes> asset_sizes(std::span<const std::uint8_t> glb, const std::string& name) {
  const auto model = parse_container(glb, name);
  if (!model) return model.error();
  AssetSizes out;
  std::uint32_t json_bytes = 0;
  std::memcpy(&json_bytes, glb.data() + 12, 4);
  out.json_bytes = json_bytes;
  const auto view_size = [&model](int view) {
    const auto bytes = view_bytes(*model, view);
    return bytes ? bytes->size() : 0;
  };
  for (const tinygltf::Mesh& mesh : model->meshes) {
    for (const tinygltf::Primitive& primitive : mesh.primitives) {
      const auto draco = primitive.extensions.find(kDracoExtension);
      if (draco != primitive.extensions.end()) {
        const tinygltf::Value& v = draco->second;
        if (v.Has("bufferView")) {
          out.triangle_bytes += view_size(v.Get("bufferView").GetNumberAsInt());
        }
        if (v.Has(kIndicesSetAside)) {
          const auto* indices = accessor_at(*model, v.Get(kIndicesSetAside).GetNumberAsInt());
          if (indices != nullptr) out.triangles += indices->count / 3;
        }
        continue;
      }
      for (const int index : {primitive.indices, position_accessor(primitive)}) {
        const auto* accessor = accessor_at(*model, index);
        if (accessor != nullptr) out.outline_bytes += view_size(accessor->bufferView);
      }
    }
  }
  return out;
}

Result<Asset> read_asset(const std::filesystem::path& file, const DecodeOptions& options) {
  auto bytes = read_file(file, std::numeric_limits<std::uint32_t>::max());
  if (!bytes) return bytes.error();
  return decode_asset(*bytes, file.string(), options);
}

Result<void> verify_asset(const Asset& asset, const std::string& name) {
  for (const AssetSlice& slice : asset.slices) {
    if (slice.mesh.triangles.empty() && slice.pslg.rings.empty()) continue;
    if (auto ok = check_mesh_against_pslg(slice.mesh, slice.pslg); !ok) {
      return refused(name + ": slice " + std::to_string(slice.index) + ": " + ok.error().message);
    }
    const Eigen::Matrix3d L = slice.T_lps_plane.linear();
    if (!((L.transpose() * L - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-4) ||
        L.determinant() < 0) {
      return refused(name + ": slice " + std::to_string(slice.index) +
                     ": its plane's frame is not a rotation");
    }
  }
  return {};
}

}  // namespace trocar
