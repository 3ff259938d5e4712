// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/draco_mesh.h"
#include "formats/asset/gltf.h"
#include "formats/asset/slice_payload.h"
#include "formats/asset/surface_payload.h"
#include "formats/base/file_io.h"
#include "formats/geometry/mesh_validity.h"
#include "formats/geometry/shared_borders.h"

namespace trocar {
namespace {

constexpr const char* kIndicesSetAside = "trocar_indices";

// tinygltf 2.7 refuses a primitive whose index accessor has no buffer view, although this is how
// glTF says that the indices are in the Draco payload. This moves the number of such an accessor
// into the Draco extension, where state_triangles() finds it.
Result<std::vector<std::uint8_t>> with_indices_set_aside(std::span<const std::uint8_t> glb,
                                                         std::size_t json_size,
                                                         nlohmann::json& root,
                                                         const std::string& name) {
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
  std::vector<std::uint8_t> bytes;
  bytes.reserve(out.size() + glb.size() -
                json_size);  // exact: an over-read would be seen by the address sanitizer
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

struct Document {
  nlohmann::json extras, nodes;
  tinygltf::Model model;
};

Result<Document> parse_container(std::span<const std::uint8_t> glb, const std::string& name) {
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
  const auto patched = with_indices_set_aside(glb, *json_bytes, *root, name);
  if (!patched) return patched.error();
  Document document;
  document.extras = std::move((*root)["extras"]);
  document.nodes = std::move((*root)["nodes"]);
  root = nlohmann::json();
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
  tinygltf::Model& model = document.model;
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
  return document;
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

int position_accessor(const tinygltf::Primitive& primitive) {
  const auto it = primitive.attributes.find("POSITION");
  return it == primitive.attributes.end() ? -1 : it->second;
}

// The number of an accessor's view if the view holds exactly its elements, packed; else nothing.
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

// A box in the plane, from the bounds of positions in units of 2^-bits mm.
struct Box {
  LatticePoint low, high;
  std::int32_t z = 0;
};
Result<Box> box_of(const tinygltf::Accessor& position, int bits) {
  const std::vector<double>&low = position.minValues, &high = position.maxValues;
  if (low.size() != 3 || high.size() != 3 || low[2] != high[2])
    return refused("accessor without bounds in the plane");
  std::array<std::int32_t, 5> steps{};
  const std::array mm{low[0], low[1], high[0], high[1], low[2]};
  for (std::size_t i = 0; i < mm.size(); ++i) {
    const double c = std::ldexp(mm[i], bits);
    if (!(std::abs(c) <= kMaxCoordinate) || c != std::rint(c))
      return refused("accessor bounds are off the lattice");
    steps[i] = static_cast<std::int32_t>(c);
  }
  return Box{{steps[0], steps[1]}, {steps[2], steps[3]}, steps[4]};
}

// What the JSON states of a slice's geometry: its record without the place of the node's text and
// the checksum.
struct Stated {
  SliceRecord record;
  bool has_hu = false, has_colours = false, has_lines = false;
  std::int32_t z = 0;  ///< of the vertices, steps
};

Result<void> state_hu(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                      const tinygltf::Value& draco, Stated& stated) {
  const auto id = [&draco](const char* name) {
    const bool there = draco.Has("attributes") && draco.Get("attributes").Has(name) &&
                       draco.Get("attributes").Get(name).IsInt();
    return there ? draco.Get("attributes").Get(name).Get<int>() : -1;
  };
  if (id("POSITION") != static_cast<int>(kDracoPositionId))
    return refused("its position has another Draco id");
  const auto attribute = primitive.attributes.find(kHuAttribute);
  stated.has_hu = attribute != primitive.attributes.end();
  if (!stated.has_hu) return {};
  const tinygltf::Accessor* hu = accessor_at(model, attribute->second);
  if (hu == nullptr || hu->componentType != TINYGLTF_COMPONENT_TYPE_SHORT ||
      hu->type != TINYGLTF_TYPE_SCALAR || hu->count != stated.record.vertices ||
      id(kHuAttribute) != static_cast<int>(kDracoHuId)) {
    return refused("HU that are not one for each vertex");
  }
  const auto colour = primitive.attributes.find(kColourAttribute);
  stated.has_colours = colour != primitive.attributes.end();
  if (!stated.has_colours) return {};
  const tinygltf::Accessor* rgb = accessor_at(model, colour->second);
  if (rgb == nullptr || rgb->componentType != TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE ||
      rgb->type != TINYGLTF_TYPE_VEC3 || !rgb->normalized || rgb->count != stated.record.vertices ||
      id(kColourAttribute) != static_cast<int>(kDracoColourId)) {
    return refused("colours that are not one for each vertex");
  }
  return {};
}

Result<void> state_triangles(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                             const Asset& asset, Stated& stated) {
  SliceRecord& record = stated.record;
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
  constexpr std::size_t kMax = std::numeric_limits<std::uint32_t>::max();
  if (position->count > kMax || indices->count > kMax || indices->count % 3 != 0 ||
      indices->count == 0) {
    return refused("triangles of an impossible count");
  }
  const int view = number("bufferView");
  const auto payload = view_bytes(model, view);
  if (!payload || payload->empty()) return refused("Draco payload outside the buffer");
  record.draco_offset = offset_of(model, view);
  record.draco_bytes = static_cast<std::uint32_t>(payload->size());
  record.vertices = static_cast<std::uint32_t>(position->count);
  record.triangles = static_cast<std::uint32_t>(indices->count / 3);
  const auto box = box_of(*position, asset.schema == 1 ? asset.lattice.bits : 0);
  if (!box) return box.error();
  record.low = box->low;
  record.high = box->high;
  stated.z = box->z;
  if (asset.schema == 1) {
    if (stated.z != 0) return refused("accessor without bounds in the plane");
    return {};
  }
  if (primitive.material < 0 ||
      static_cast<std::size_t>(primitive.material) >= asset.materials.size())
    return refused("its material is not in the list");
  record.material = static_cast<std::uint16_t>(primitive.material);
  return state_hu(model, primitive, it->second, stated);
}

Result<void> record_lines(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                          SliceRecord& record) {
  const tinygltf::Accessor* position = accessor_at(model, position_accessor(primitive));
  const tinygltf::Accessor* index = accessor_at(model, primitive.indices);
  if (position == nullptr || index == nullptr ||
      position->componentType != TINYGLTF_COMPONENT_TYPE_FLOAT ||
      position->type != TINYGLTF_TYPE_VEC3 || index->type != TINYGLTF_TYPE_SCALAR) {
    return refused("outline without positions or indices");
  }
  const bool narrow = index->componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
  const bool wide = index->componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
  record.segment_index_bytes = narrow ? 2 : 4;
  const auto points = packed_view(model, *position, 3 * sizeof(float));
  const auto segments = packed_view(model, *index, record.segment_index_bytes);
  if (!points || !segments || !(narrow || wide) || index->count != 2 * position->count) {
    return refused("outline data outside the buffer or of the wrong size");
  }
  record.outline_offset = offset_of(model, *points);
  record.outline_vertices = static_cast<std::uint32_t>(position->count);
  record.segments_offset = offset_of(model, *segments);
  return {};
}

// Of each entry of a node whose first has this index: one without a mesh, else its triangles, which
// its lines may follow.
Result<std::vector<Stated>> state_entries(const tinygltf::Model& model, const tinygltf::Node& node,
                                          int first_index, const Asset& asset) {
  std::vector<Stated> out(1);
  out[0].record.index = first_index;
  if (node.mesh < 0) return out;
  const auto at = [&out] { return "slice " + std::to_string(out.back().record.index) + ": "; };
  if (static_cast<std::size_t>(node.mesh) >= model.meshes.size()) {
    return refused(at() + "mesh index out of range");
  }
  const std::vector<tinygltf::Primitive>& primitives =
      model.meshes[static_cast<std::size_t>(node.mesh)].primitives;
  const auto has_mode = [&primitives](std::size_t place, int mode) {
    return place < primitives.size() && primitives[place].mode == mode;
  };
  const bool is_right_1 = primitives.size() == 2 && has_mode(1, TINYGLTF_MODE_LINE);
  if (asset.schema == 1 ? !is_right_1 : primitives.empty())
    return refused(at() + "expected one triangles and one lines primitive");
  for (std::size_t i = 0; i < primitives.size(); ++i) {
    if (i > 0) {
      if (out.size() == kMaxNodeEntries ||
          out.back().record.index == std::numeric_limits<int>::max())
        return refused(at() + "too many slices in its node");
      const int next = out.back().record.index + 1;
      out.emplace_back().record.index = next;
    }
    Stated& stated = out.back();
    if (!has_mode(i, TINYGLTF_MODE_TRIANGLES))
      return refused(at() + "expected one triangles and one lines primitive");
    if (auto ok = state_triangles(model, primitives[i], asset, stated); !ok)
      return refused(at() + ok.error().message);
    stated.has_lines = has_mode(i + 1, TINYGLTF_MODE_LINE);
    if (!stated.has_lines) continue;
    if (auto ok = record_lines(model, primitives[++i], stated.record); !ok)
      return refused(at() + ok.error().message);
  }
  return out;
}

// How many entries the nodes have: triangles, and nodes without a mesh.
std::size_t count_entries(const tinygltf::Model& model, const std::vector<int>& nodes) {
  std::size_t count = 0;
  for (const int node : nodes) {
    const auto at = static_cast<std::size_t>(node);
    const int mesh = node < 0 || at >= model.nodes.size() ? -1 : model.nodes[at].mesh;
    if (mesh < 0 || static_cast<std::size_t>(mesh) >= model.meshes.size()) {
      ++count;
      continue;
    }
    const auto& primitives = model.meshes[static_cast<std::size_t>(mesh)].primitives;
    count += static_cast<std::size_t>(std::count_if(
        primitives.begin(), primitives.end(),
        [](const tinygltf::Primitive& p) { return p.mode == TINYGLTF_MODE_TRIANGLES; }));
  }
  return count;
}

Result<void> decode_geometry(const tinygltf::Model& model, const Stated& stated, const Asset& asset,
                             AssetSlice& slice) {
  const SliceRecord& record = stated.record;
  if (record.is_empty()) return {};
  const std::span<const std::uint8_t> buffer(model.buffers[0].data);
  const GeometryBytes bytes{buffer.subspan(record.draco_offset, record.draco_bytes),
                            buffer.subspan(record.outline_offset, record.outline_bytes()),
                            buffer.subspan(record.segments_offset, record.segments_bytes())};
  if (asset.schema == 1) return decode_slice_geometry_1(record, bytes, asset.lattice, slice);
  const auto facts = decode_slice_geometry(bytes.draco, slice);
  if (!facts) return facts.error();
  if (facts->z != stated.z) return refused("accessor bounds differ from the vertices");
  if (facts->has_colours != stated.has_colours)
    return refused("colours that its JSON does not name");
  if (auto ok = compare_geometry(record, stated.has_hu, slice); !ok) return ok;
  return stated.has_lines ? compare_lines(record, bytes, facts->z, slice) : Result<void>();
}

// The slice index, if any. Checks contract 2 of asset_index.h for everything but the slices.
Result<std::optional<IndexedFile>> index_of(ByteSource& source, const Asset& asset,
                                            const nlohmann::json& extras,
                                            const nlohmann::json& nodes, std::size_t entries) {
  auto index = find_index(source);
  if (!index || !*index) return index;
  const IndexedFile& file = **index;
  const auto text = read_document_texts(source, file);
  if (!text) return text.error();
  const Error differ = refused("its slice index and its JSON differ");
  const auto said = parse_json_text(text->extras);
  if (file.header.entries != entries || file.is_schema_1() != (asset.schema == 1) || !said ||
      *said != extras)
    return differ;
  if (file.is_schema_1()) return index;
  const auto frame = parse_json_text(text->frame);
  if (!frame || *frame != nodes[kFrameNode]) return differ;
  return index;
}

// Checks contract 2 of asset_index.h for the slices, one after the other.
class RecordChecks {
 public:
  RecordChecks(ByteSource& source, const IndexedFile& index) : source_(source), index_(index) {}

  Result<void> check(const SliceRecord& expected, const nlohmann::json& node) {
    const auto record = read_record(source_, index_, place_++);
    if (!record) return record.error();
    if (!agree(*record, expected)) return refused("the slice index and the JSON differ");
    // Slices may not share bytes other than a node's text, so that the work is bounded by the
    // file's size.
    const bool is_node_known =
        node_ == &node && node_offset_ == record->node_offset && node_bytes_ == record->node_bytes;
    if (!is_node_known) text_ += record->node_bytes;
    geometry_ += record->draco_bytes + expected.outline_bytes() + expected.segments_bytes();
    if (text_ > index_.header.json_bytes || geometry_ > index_.header.binary_bytes)
      return refused("the slice index has slices that share their bytes");
    const auto bytes = read_slice_bytes(source_, index_, *record);
    if (!bytes) return bytes.error();
    if (is_node_known) return {};
    const auto said = parse_json_text(bytes->node);
    if (!said || *said != node) return refused("the slice index and the JSON differ");
    node_ = &node;
    node_offset_ = record->node_offset;
    node_bytes_ = record->node_bytes;
    return {};
  }

 private:
  bool agree(const SliceRecord& a, const SliceRecord& b) const {
    const bool both = a.index == b.index && a.material == b.material &&
                      a.draco_offset == b.draco_offset && a.draco_bytes == b.draco_bytes;
    return both &&
           (!index_.is_schema_1() ||
            (a.vertices == b.vertices && a.triangles == b.triangles && a.low == b.low &&
             a.high == b.high && a.outline_offset == b.outline_offset &&
             a.outline_vertices == b.outline_vertices && a.segments_offset == b.segments_offset &&
             a.segment_index_bytes == b.segment_index_bytes));
  }

  ByteSource& source_;
  const IndexedFile& index_;
  std::uint32_t place_ = 0, node_offset_ = 0, node_bytes_ = 0;  // of the node before
  const nlohmann::json* node_ = nullptr;
  std::uint64_t text_ = 0, geometry_ = 0;
};

// Nodes of the scene beside the scan's that say that they are a surface.
std::vector<std::size_t> surface_nodes(const tinygltf::Model& model, const nlohmann::json& nodes) {
  std::vector<std::size_t> out;
  if (model.scenes.empty()) return out;
  static const nlohmann::json::json_pointer kSaysSo("/extras/trocar/surface");
  for (const int node : model.scenes[0].nodes) {
    if (node <= 0 || static_cast<std::size_t>(node) >= std::min(model.nodes.size(), nodes.size()))
      continue;
    const auto at = static_cast<std::size_t>(node);
    if (nodes[at].contains(kSaysSo)) out.push_back(at);
  }
  return out;
}

// Everything but the payload's contents.
struct StatedSurface {
  AssetSurface surface;
  std::size_t vertices = 0, triangles = 0;
  std::span<const std::uint8_t> draco;
  std::vector<double> low, high;
};
Result<StatedSurface> state_surface(const tinygltf::Model& model, const tinygltf::Node& node,
                                    const nlohmann::json& json_node, std::size_t materials) {
  const nlohmann::json& said = json_node["extras"]["trocar"];
  const auto number = [&said](const char* key) {
    const auto at = said.find(key);
    return at != said.end() && at->is_number() ? at->get<double>()
                                               : std::numeric_limits<double>::quiet_NaN();
  };
  StatedSurface out;
  const double material = number("surface"), bits = number("lattice_bits"),
               distance = number("distance_mm");
  if (!(material >= 0 && material < static_cast<double>(materials) &&
        material == std::rint(material)))
    return refused("its material is not a number of the list");
  if (!(bits >= kMinLatticeBits && bits <= kMaxLatticeBits && bits == std::rint(bits)))
    return refused("its lattice_bits are no lattice's");
  if (!(distance >= 0 && distance < 1e6)) return refused("its distance_mm is no distance");
  out.surface.material = static_cast<int>(material);
  out.surface.surface.lattice.bits = static_cast<int>(bits);
  out.surface.distance_mm = distance;
  const auto matrix = json_node.find("matrix");
  if (matrix == json_node.end() || *matrix != surface_matrix(out.surface.surface.lattice))
    return refused("its matrix is not its lattice's");

  if (node.mesh < 0 || static_cast<std::size_t>(node.mesh) >= model.meshes.size())
    return refused("mesh index out of range");
  const auto& primitives = model.meshes[static_cast<std::size_t>(node.mesh)].primitives;
  if (primitives.size() != 1 || primitives[0].mode != TINYGLTF_MODE_TRIANGLES)
    return refused("expected one primitive of triangles");
  const auto it = primitives[0].extensions.find(kDracoExtension);
  const auto index = [&](const char* key) {
    const bool there = it != primitives[0].extensions.end() && it->second.IsObject() &&
                       it->second.Has(key) && it->second.Get(key).IsInt();
    return there ? it->second.Get(key).Get<int>() : -1;
  };
  const tinygltf::Accessor* position = accessor_at(model, position_accessor(primitives[0]));
  const tinygltf::Accessor* indices = accessor_at(model, index(kIndicesSetAside));
  const auto payload = view_bytes(model, index("bufferView"));
  if (position == nullptr || indices == nullptr || !payload || payload->empty())
    return refused("triangles without a Draco payload");
  constexpr std::size_t kMax = std::numeric_limits<std::uint32_t>::max();
  if (position->count > kMax || indices->count > kMax || indices->count % 3 != 0)
    return refused("triangles of an impossible count");
  out.vertices = position->count;
  out.triangles = indices->count / 3;
  out.draco = *payload;
  out.low = position->minValues;
  out.high = position->maxValues;
  return out;
}

Result<AssetSurface> decode_stated_surface(StatedSurface stated) {
  auto decoded = decode_surface(stated.draco, stated.vertices, stated.triangles,
                                stated.surface.surface.lattice);
  if (!decoded) return decoded.error();
  for (std::size_t k = 0; k < 3; ++k) {
    double low = kMaxSpaceCoordinate, high = -kMaxSpaceCoordinate;
    for (const SpacePoint& p : decoded->vertices) {
      low = std::min(low, static_cast<double>(p[k]));
      high = std::max(high, static_cast<double>(p[k]));
    }
    if (stated.low.size() != 3 || stated.high.size() != 3 || stated.low[k] != low ||
        stated.high[k] != high)
      return refused("accessor bounds differ from the vertices");
  }
  stated.surface.surface = std::move(*decoded);
  return std::move(stated.surface);
}

Result<void> decode_surfaces(const tinygltf::Model& model, const nlohmann::json& nodes,
                             Asset& asset) {
  std::size_t bytes = 0;
  for (const std::size_t node : surface_nodes(model, nodes)) {
    auto stated = state_surface(model, model.nodes[node], nodes[node], asset.materials.size());
    if (!stated) return stated.error();
    // They may not share bytes, so that the work is bounded by the file's size.
    bytes += stated->draco.size();
    if (bytes > model.buffers[0].data.size()) return refused("they share their bytes");
    auto surface = decode_stated_surface(std::move(*stated));
    if (!surface) return surface.error();
    asset.surfaces.push_back(std::move(*surface));
  }
  return {};
}

struct NodeTree {
  Eigen::Affine3d frame = Eigen::Affine3d::Identity();
  std::size_t list = 0;  ///< the node whose children are the entries
};
Result<NodeTree> node_tree(const tinygltf::Model& model, const nlohmann::json& nodes,
                           const Asset& asset) {
  NodeTree out;
  if (model.nodes.empty() || model.nodes.size() != nodes.size())
    return refused("no scan node, or too many slices");
  if (asset.schema != 1) {
    const auto leads_to = [&model](std::size_t node, std::size_t child) {
      return model.nodes.size() > child &&
             model.nodes[node].children == std::vector<int>{static_cast<int>(child)};
    };
    if (!leads_to(0, kFrameNode) || !leads_to(kFrameNode, kListNode))
      return refused("no scan node, or too many slices");
    const auto frame = transform_of_node(nodes[kFrameNode], asset.lattice);
    if (!frame) return frame.error();
    out = {*frame, kListNode};
  }
  if (model.nodes[out.list].children.size() > kMaxSlices ||
      count_entries(model, model.nodes[out.list].children) > kMaxSlices)
    return refused("no scan node, or too many slices");
  return out;
}

struct Entry {
  AssetSlice slice;
  Stated stated;
};
// The entries of a node without their geometry. `before` is the entry before, or null.
Result<std::vector<Entry>> read_entries(const tinygltf::Model& model,
                                        const nlohmann::json& json_node, std::size_t node,
                                        const AssetSlice* before, const Eigen::Affine3d& frame,
                                        const Asset& asset) {
  std::vector<Entry> out;
  if (asset.schema == 1) {
    auto slice = slice_of_node_1(json_node);
    if (!slice) return slice.error();
    auto stated = state_entries(model, model.nodes[node], slice->index, asset);
    if (!stated) return stated.error();
    out.push_back({std::move(*slice), stated->front()});
    return out;
  }
  const auto said = entry_of_node(json_node, asset.lattice);
  const std::int64_t next = before == nullptr ? 0 : std::int64_t{before->index} + 1;
  if (!said) return refused("node " + std::to_string(node) + ": " + said.error().message);
  if (!said->index && next > std::numeric_limits<int>::max())
    return refused("slice indices do not ascend");
  const int first = said->index ? *said->index : static_cast<int>(next);
  const auto all = state_entries(model, model.nodes[node], first, asset);
  if (!all) return all.error();
  if ((!said->mean_hu.empty() && said->mean_hu.size() != all->size()) ||
      (said->z_mm && all->size() > 1))
    return refused("node " + std::to_string(node) + ": its figures are not one for each slice");
  for (const Stated& stated : *all) {
    const int index = stated.record.index;
    auto slice =
        slice_of_entry(*said, index, stated.record.material, frame, asset.lattice.to_mm(stated.z));
    if (!slice) return refused("slice " + std::to_string(index) + ": " + slice.error().message);
    out.push_back({std::move(*slice), stated});
  }
  return out;
}

bool is_wanted(const DecodeOptions& options, int index) {
  return options.all || std::find(options.slice_indices.begin(), options.slice_indices.end(),
                                  index) != options.slice_indices.end();
}

}  // namespace

Result<Asset> decode_asset(std::span<const std::uint8_t> glb, const std::string& name,
                           const DecodeOptions& options) {
  auto document = parse_container(glb, name);
  if (!document) return document.error();
  const tinygltf::Model& model = document->model;
  const nlohmann::json& extras = document->extras;
  const nlohmann::json& nodes = document->nodes;
  Asset asset;
  const auto stated_slices = read_document_extras(extras, asset, name);
  if (!stated_slices) return stated_slices.error();
  asset.generator = model.asset.generator;

  const auto tree = node_tree(model, nodes, asset);
  if (!tree) return refused(name + ": " + tree.error().message);
  const std::vector<int>& children = model.nodes[tree->list].children;
  MemorySource source(glb);
  const auto index = index_of(source, asset, extras, nodes, count_entries(model, children));
  if (!index) return refused(name + ": " + index.error().message);
  std::optional<RecordChecks> records;
  if (*index) records.emplace(source, **index);
  std::size_t slices = 0;
  for (const int child : children) {
    const auto at = static_cast<std::size_t>(child);
    if (child <= 0 || at >= model.nodes.size()) return refused(name + ": node index out of range");
    auto entries =
        read_entries(model, nodes[at], at, asset.slices.empty() ? nullptr : &asset.slices.back(),
                     tree->frame, asset);
    if (!entries) return refused(name + ": " + entries.error().message);
    for (auto& [slice, stated] : *entries) {
      const AssetSlice* const before = asset.slices.empty() ? nullptr : &asset.slices.back();
      const std::string where = name + ": slice " + std::to_string(slice.index) + ": ";
      if (records) {
        if (auto ok = records->check(stated.record, nodes[at]); !ok)
          return refused(where + ok.error().message);
      }
      if (is_wanted(options, slice.index)) {
        if (auto ok = decode_geometry(model, stated, asset, slice); !ok)
          return refused(where + ok.error().message);
      }
      if (before != nullptr &&
          std::pair(before->index, before->material) >= std::pair(slice.index, slice.material)) {
        return refused(name + ": slice indices do not ascend");
      }
      slices += before == nullptr || before->index != slice.index ? 1 : 0;
      asset.lines = asset.lines || stated.has_lines;
      asset.colours = asset.colours || stated.has_colours;
      asset.slices.push_back(std::move(slice));
    }
  }
  if (asset.schema != 1 && slices != *stated_slices)
    return refused(name + ": it has " + std::to_string(slices) + " slices and states " +
                   std::to_string(*stated_slices));
  if (*index && !asset.slices.empty() &&
      ((*index)->header.first_index != asset.slices.front().index ||
       (*index)->header.last_index != asset.slices.back().index)) {
    return refused(name + ": its slice index and its JSON differ");
  }
  if (options.all) {
    if (auto ok = decode_surfaces(model, nodes, asset); !ok)
      return refused(name + ": surface: " + ok.error().message);
  }
  return asset;
}

Result<AssetSizes> asset_sizes(std::span<const std::uint8_t> glb, const std::string& name) {
  const auto document = parse_container(glb, name);
  if (!document) return document.error();
  const tinygltf::Model* const model = &document->model;
  AssetSizes out;
  MemorySource source(glb);
  out.json_bytes = *json_bytes_of(source);  // cannot fail: the container was parsed
  const auto index = find_index(source);
  if (index && *index) out.index_bytes = (*index)->bytes();
  const auto view_size = [&model](int view) {
    const auto bytes = view_bytes(*model, view);
    return bytes ? bytes->size() : 0;
  };
  std::vector<bool> is_surface(model->meshes.size(), false);
  for (const std::size_t node : surface_nodes(*model, document->nodes)) {
    const int mesh = model->nodes[node].mesh;
    if (mesh >= 0 && static_cast<std::size_t>(mesh) < is_surface.size())
      is_surface[static_cast<std::size_t>(mesh)] = true;
  }
  for (const tinygltf::Mesh& mesh : model->meshes) {
    const bool of_surface = is_surface[static_cast<std::size_t>(&mesh - model->meshes.data())];
    for (const tinygltf::Primitive& primitive : mesh.primitives) {
      const auto draco = primitive.extensions.find(kDracoExtension);
      if (draco != primitive.extensions.end()) {
        const tinygltf::Value& v = draco->second;
        if (v.Has("bufferView")) {
          (of_surface ? out.surface_bytes : out.triangle_bytes) +=
              view_size(v.Get("bufferView").GetNumberAsInt());
        }
        if (v.Has(kIndicesSetAside) && !of_surface) {
          const auto* indices = accessor_at(*model, v.Get(kIndicesSetAside).GetNumberAsInt());
          if (indices != nullptr) out.triangles += indices->count / 3;
        }
        continue;
      }
      for (const int number : {primitive.indices, position_accessor(primitive)}) {
        const auto* accessor = accessor_at(*model, number);
        if (accessor != nullptr) out.outline_bytes += view_size(accessor->bufferView);
      }
    }
  }
  return out;
}

Result<Asset> read_asset(const std::filesystem::path& file) {
  auto bytes = read_file(file, std::numeric_limits<std::uint32_t>::max());
  if (!bytes) return bytes.error();
  return decode_asset(*bytes, file.string());
}

namespace {

// The materials of one slice: in one plane, and without overlap.
Result<void> verify_together(std::span<const AssetSlice> materials) {
  std::vector<Pslg> outlines;
  for (const AssetSlice& one : materials) {
    if (one.z_mm != materials[0].z_mm ||
        one.T_lps_plane.matrix() != materials[0].T_lps_plane.matrix())
      return refused("its materials lie in different planes");
    outlines.push_back(one.pslg);
  }
  if (auto ok = check_shared_borders(outlines, outlines); !ok)
    return refused("its materials: " + ok.error().message);
  return {};
}

}  // namespace

std::span<const AssetSlice> materials_of_slice(const Asset& asset, std::size_t first) {
  std::size_t end = first + 1;
  while (end < asset.slices.size() && asset.slices[end].index == asset.slices[first].index)
    ++end;
  return std::span(asset.slices).subspan(first, end - first);
}

std::size_t slice_count(const Asset& asset) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < asset.slices.size(); i += materials_of_slice(asset, i).size())
    ++count;
  return count;
}

Result<void> verify_asset(const Asset& asset, const std::string& name) {
  for (const AssetSlice& slice : asset.slices) {
    if (slice.mesh.triangles.empty() && slice.pslg.rings.empty()) continue;
    if (auto ok = check_mesh_against_pslg(slice.mesh, slice.pslg); !ok) {
      return refused(name + ": slice " + std::to_string(slice.index) + ": " + ok.error().message);
    }
    if (!slice.hu.empty() && slice.hu.size() != slice.mesh.vertices.size())
      return refused(name + ": slice " + std::to_string(slice.index) +
                     ": not an HU for each vertex");
    const Eigen::Matrix3d L = slice.T_lps_plane.linear();
    if (!((L.transpose() * L - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-4) ||
        L.determinant() < 0) {
      return refused(name + ": slice " + std::to_string(slice.index) +
                     ": its plane's frame is not a rotation");
    }
  }
  for (std::size_t i = 0; i < asset.slices.size(); i += materials_of_slice(asset, i).size()) {
    const auto materials = materials_of_slice(asset, i);
    if (materials.size() < 2) continue;
    if (auto ok = verify_together(materials); !ok)
      return refused(name + ": slice " + std::to_string(asset.slices[i].index) + ": " +
                     ok.error().message);
  }
  for (const AssetSurface& one : asset.surfaces) {
    if (auto ok = check_triangle_surface(one.surface); !ok)
      return refused(name + ": surface of material " + std::to_string(one.material) + ": " +
                     ok.error().message);
  }
  return {};
}

}  // namespace trocar
