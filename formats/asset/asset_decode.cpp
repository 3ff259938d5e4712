// SPDX-License-Identifier: Apache-2.0
// Decodes a complete file: container, JSON, slice index, then slice by slice.
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/hu_section.h"
#include "formats/asset/slice_payload.h"
#include "formats/asset/stated_entries.h"
#include "formats/asset/surface_payload.h"
#include "formats/base/file_io.h"

namespace trocar {
namespace {

Result<void> decode_geometry(const tinygltf::Model& model, const StatedEntry& stated,
                             AssetSlice& slice) {
  const EntryRecord& record = stated.record;
  if (record.is_empty()) return {};
  const std::span<const std::uint8_t> buffer(model.buffers[0].data);
  const auto facts =
      decode_slice_geometry(buffer.subspan(record.draco_offset, record.draco_bytes), slice);
  if (!facts) return facts.error();
  if (facts->z != stated.z) return refused("accessor bounds differ from the vertices");
  if (facts->has_colours != stated.has_colours)
    return refused("colours that its JSON does not name");
  if (auto ok = compare_geometry(stated, slice); !ok) return ok;
  return stated.has_lines ? compare_lines(stated, buffer, slice) : Result<void>();
}

// The slice index, if any. Checks contract 2 of asset_index.h except for the slices.
Result<std::optional<IndexedFile>> index_of(ByteSource& source, const nlohmann::json& extras,
                                            const nlohmann::json& nodes, std::size_t entries) {
  auto index = find_index(source);
  if (!index || !*index) return index;
  const IndexedFile& file = **index;
  const auto text = read_document_texts(source, file);
  if (!text) return text.error();
  const Error differ = refused("its slice index and its JSON differ");
  const auto indexed_extras = parse_json_text(text->extras);
  if (file.header.entries != entries || !indexed_extras || *indexed_extras != extras) return differ;
  const auto frame = parse_json_text(text->frame);
  if (!frame || *frame != nodes[kFrameNode]) return differ;
  return index;
}

// Checks contract 2 of asset_index.h for the slices, one after the other.
class RecordChecks {
 public:
  RecordChecks(ByteSource& source, const IndexedFile& index) : source_(source), index_(index) {}

  Result<void> check(const StatedEntry& stated, const nlohmann::json& node) {
    const EntryRecord& expected = stated.record;
    const auto record = read_record(source_, index_, next_++);
    if (!record) return record.error();
    if (record->index != expected.index || record->material != expected.material ||
        record->draco_offset != expected.draco_offset ||
        record->draco_bytes != expected.draco_bytes)
      return refused("the slice index and the JSON differ");
    // Slices may not share bytes other than a node's text, so that the work is bounded by the
    // file's size.
    const bool is_node_known =
        node_ == &node && node_offset_ == record->node_offset && node_bytes_ == record->node_bytes;
    if (!is_node_known) text_ += record->node_bytes;
    geometry_ += record->draco_bytes + stated.outline_bytes() + stated.segments_bytes();
    if (text_ > index_.header.json_bytes || geometry_ > index_.header.binary_bytes)
      return refused("the slice index has slices that share their bytes");
    const auto bytes = read_slice_bytes(source_, index_, *record);
    if (!bytes) return bytes.error();
    if (is_node_known) return {};
    const auto indexed_node = parse_json_text(bytes->node);
    if (!indexed_node || *indexed_node != node)
      return refused("the slice index and the JSON differ");
    node_ = &node;
    node_offset_ = record->node_offset;
    node_bytes_ = record->node_bytes;
    return {};
  }

 private:
  ByteSource& source_;
  const IndexedFile& index_;
  std::uint32_t next_ = 0;                // number of the next record
  const nlohmann::json* node_ = nullptr;  // the previous record's node
  std::uint32_t node_offset_ = 0, node_bytes_ = 0;
  std::uint64_t text_ = 0, geometry_ = 0;  // bytes of the records so far
};

// Checks the tree of nodes, and returns the frame.
Result<Eigen::Affine3d> frame_of(const tinygltf::Model& model, const nlohmann::json& nodes,
                                 const Asset& asset) {
  if (model.nodes.size() != nodes.size()) return refused("no scan node, or too many slices");
  const auto leads_to = [&model](std::size_t node, std::size_t child) {
    return model.nodes.size() > child &&
           model.nodes[node].children == std::vector<int>{static_cast<int>(child)};
  };
  if (!leads_to(0, kFrameNode) || !leads_to(kFrameNode, kListNode) ||
      model.nodes[kListNode].children.size() > kMaxSlices ||
      count_entries(model, model.nodes[kListNode].children) > kMaxSlices)
    return refused("no scan node, or too many slices");
  return transform_of_node(nodes[kFrameNode], asset.lattice);
}

struct Entry {
  AssetSlice slice;
  StatedEntry stated;
};
// The entries of a node, without their geometry. `before` is the previous entry, or null.
Result<std::vector<Entry>> read_entries(const tinygltf::Model& model,
                                        const nlohmann::json& json_node, std::size_t node,
                                        const AssetSlice* before, const Eigen::Affine3d& frame,
                                        const Asset& asset) {
  std::vector<Entry> out;
  const auto header = entry_of_node(json_node, asset.lattice);
  const std::int64_t next = before == nullptr ? 0 : std::int64_t{before->index} + 1;
  if (!header) return refused("node " + std::to_string(node) + ": " + header.error().message);
  if (!header->index && next > std::numeric_limits<int>::max())
    return refused("slice indices do not ascend");
  const int first = header->index ? *header->index : static_cast<int>(next);
  const auto all = stated_entries(model, model.nodes[node], first, asset);
  if (!all) return all.error();
  if ((!header->mean_hu.empty() && header->mean_hu.size() != all->size()) ||
      (header->z_mm && all->size() > 1))
    return refused("node " + std::to_string(node) + ": its figures are not one for each slice");
  for (const StatedEntry& stated : *all) {
    const int index = stated.record.index;
    auto slice = slice_of_entry(*header, index, stated.record.material, frame,
                                asset.lattice.to_mm(stated.z));
    if (!slice) return refused("slice " + std::to_string(index) + ": " + slice.error().message);
    out.push_back({std::move(*slice), stated});
  }
  return out;
}

// The HU of the decoded slices. Where there is a slice index, the extras state where the volumes
// lie, as a reader of some slices relies on.
Result<void> decode_hu_volumes(const GltfDocument& document, bool has_index,
                               const DecodeOptions& options, Asset& asset) {
  auto sections = hu_sections(trocar_extras(document.extras), asset.lattice);
  if (!sections) return sections.error();
  if (sections->empty()) return {};
  if (document.model.buffers.empty()) return refused("its HU have no buffer");
  const std::vector<unsigned char>& buffer = document.model.buffers[0].data;
  MemorySource source(buffer);
  for (HuSection& section : *sections) {
    const auto bytes = view_bytes(document.model, static_cast<int>(section.view));
    if (!bytes) return refused("its HU have no buffer view");
    const auto offset = static_cast<std::uint64_t>(bytes->data() - buffer.data());
    if (has_index && (section.offset != offset || section.bytes != bytes->size()))
      return refused("its HU are not where its JSON states");
    section.offset = offset;
    section.bytes = bytes->size();
    if (section.bytes < 8 * std::uint64_t{section.planes})
      return refused("the directory of its HU is damaged");
    if (auto ok = check_hu_directory(source, 0, section, options.all, asset); !ok) return ok;
  }
  return read_hu_volumes(source, 0, buffer.size(), *sections, options.all, asset);
}

bool is_wanted(const DecodeOptions& options, int index) {
  return options.all || std::find(options.slice_indices.begin(), options.slice_indices.end(),
                                  index) != options.slice_indices.end();
}

// Reads the numbers in the node's extras; the surface has no geometry yet.
Result<AssetSurface> read_surface_node(const nlohmann::json& json_node, std::size_t materials) {
  const nlohmann::json& extras = json_node["extras"]["trocar"];
  const auto number = [&extras](const char* key) {
    const auto at = extras.find(key);
    return at != extras.end() && at->is_number() ? at->get<double>()
                                                 : std::numeric_limits<double>::quiet_NaN();
  };
  AssetSurface out;
  const double material = number("surface"), bits = number("lattice_bits"),
               distance = number("distance_mm");
  if (!(material >= 0 && material < static_cast<double>(materials) &&
        material == std::rint(material)))
    return refused("its material is not a number of the list");
  if (!(bits >= kMinLatticeBits && bits <= kMaxLatticeBits && bits == std::rint(bits)))
    return refused("its lattice_bits are no lattice's");
  if (!(distance >= 0 && distance < 1e6)) return refused("its distance_mm is no distance");
  out.material = static_cast<int>(material);
  out.surface.lattice.bits = static_cast<int>(bits);
  out.distance_mm = distance;
  const auto matrix = json_node.find("matrix");
  if (matrix == json_node.end() || *matrix != surface_matrix(out.surface.lattice))
    return refused("its matrix is not its lattice's");
  return out;
}

// The payload of a surface's node.
Result<DracoPrimitive> surface_primitive(const tinygltf::Model& model, const tinygltf::Node& node) {
  const tinygltf::Mesh* const mesh = element_at(model.meshes, node.mesh);
  if (mesh == nullptr) return refused("mesh index out of range");
  const auto& primitives = mesh->primitives;
  if (primitives.size() != 1 || primitives[0].mode != TINYGLTF_MODE_TRIANGLES)
    return refused("expected one primitive of triangles");
  return draco_primitive(model, primitives[0]);
}

Result<TriangleSurface> decode_surface_geometry(const DracoPrimitive& draco,
                                                const Lattice& lattice) {
  auto decoded = decode_surface(draco.payload, draco.vertices, draco.triangles, lattice);
  if (!decoded) return decoded.error();
  const auto [low, high] = box_around(decoded->vertices);
  const std::vector<double>&stated_low = draco.position->minValues,
        &stated_high = draco.position->maxValues;
  if (!std::equal(low.begin(), low.end(), stated_low.begin(), stated_low.end()) ||
      !std::equal(high.begin(), high.end(), stated_high.begin(), stated_high.end()))
    return refused("accessor bounds differ from the vertices");
  return decoded;
}

Result<void> decode_surfaces(const GltfDocument& document, Asset& asset) {
  const tinygltf::Model& model = document.model;
  std::size_t bytes = 0;
  for (const std::size_t node : surface_nodes(document)) {
    auto surface = read_surface_node(document.nodes[node], asset.materials.size());
    if (!surface) return surface.error();
    const auto draco = surface_primitive(model, model.nodes[node]);
    if (!draco) return draco.error();
    // Surfaces may not share bytes, so that the work is bounded by the file's size.
    bytes += draco->payload.size();
    if (bytes > model.buffers[0].data.size()) return refused("they share their bytes");
    auto geometry = decode_surface_geometry(*draco, surface->surface.lattice);
    if (!geometry) return geometry.error();
    surface->surface = std::move(*geometry);
    asset.surfaces.push_back(std::move(*surface));
  }
  return {};
}

}  // namespace

Result<Asset> decode_asset(std::span<const std::uint8_t> glb, const std::string& name,
                           const DecodeOptions& options) {
  auto document = parse_gltf(glb, name);
  if (!document) return document.error();
  const tinygltf::Model& model = document->model;
  const nlohmann::json& extras = document->extras;
  const nlohmann::json& nodes = document->nodes;
  Asset asset;
  const auto stated_slices = read_document_extras(extras, asset, name);
  if (!stated_slices) return stated_slices.error();
  asset.generator = model.asset.generator;

  const auto frame = frame_of(model, nodes, asset);
  if (!frame) return refused(name + ": " + frame.error().message);
  const std::vector<int>& children = model.nodes[kListNode].children;
  MemorySource source(glb);
  const auto index = index_of(source, extras, nodes, count_entries(model, children));
  if (!index) return refused(name + ": " + index.error().message);
  std::optional<RecordChecks> records;
  if (*index) records.emplace(source, **index);
  // Slices may share their geometry. This bounds how often, and so the memory for a hostile file.
  std::uint64_t triangles_left =
                    max_triangles_in(model.buffers.empty() ? 0 : model.buffers[0].data.size()),
                outline_left = triangles_left;
  for (const int child : children) {
    const auto at = static_cast<std::size_t>(child);
    if (child <= 0 || at >= model.nodes.size()) return refused(name + ": node index out of range");
    auto entries = read_entries(
        model, nodes[at], at, asset.slices.empty() ? nullptr : &asset.slices.back(), *frame, asset);
    if (!entries) return refused(name + ": " + entries.error().message);
    for (auto& [slice, stated] : *entries) {
      const AssetSlice* const before = asset.slices.empty() ? nullptr : &asset.slices.back();
      const std::string where = name + ": slice " + std::to_string(slice.index) + ": ";
      if (records) {
        if (auto ok = records->check(stated, nodes[at]); !ok)
          return refused(where + ok.error().message);
      }
      if (is_wanted(options, slice.index)) {
        if (stated.triangles > triangles_left || stated.outline_vertices > outline_left)
          return refused(where + "more geometry than a file of its size may have");
        triangles_left -= stated.triangles;
        outline_left -= stated.outline_vertices;
        if (auto ok = decode_geometry(model, stated, slice); !ok)
          return refused(where + ok.error().message);
      }
      if (before != nullptr &&
          std::pair(before->index, before->material) >= std::pair(slice.index, slice.material)) {
        return refused(name + ": slice indices do not ascend");
      }
      asset.lines = asset.lines || stated.has_lines;
      asset.colours = asset.colours || stated.has_colours;
      asset.slices.push_back(std::move(slice));
    }
  }
  const std::size_t slices = slice_count(asset);
  if (slices != *stated_slices)
    return refused(name + ": it has " + std::to_string(slices) + " slices and states " +
                   std::to_string(*stated_slices));
  if (*index && !asset.slices.empty() &&
      ((*index)->header.first_index != asset.slices.front().index ||
       (*index)->header.last_index != asset.slices.back().index)) {
    return refused(name + ": its slice index and its JSON differ");
  }
  if (auto ok = decode_hu_volumes(*document, index->has_value(), options, asset); !ok)
    return refused(name + ": " + ok.error().message);
  if (options.all) {
    if (auto ok = decode_surfaces(*document, asset); !ok)
      return refused(name + ": surface: " + ok.error().message);
  }
  return asset;
}

Result<Asset> read_asset(const std::filesystem::path& file) {
  auto bytes = read_file(file, std::numeric_limits<std::uint32_t>::max());
  if (!bytes) return bytes.error();
  return decode_asset(*bytes, file.string());
}

}  // namespace trocar
