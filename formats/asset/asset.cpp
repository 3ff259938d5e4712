// SPDX-License-Identifier: Apache-2.0
// Decodes a complete file: container, JSON, slice index, then slice by slice.
#include "formats/asset/asset.h"

#include <limits>
#include <nlohmann/json.hpp>

#include "formats/asset/asset_index.h"
#include "formats/asset/gltf_document.h"
#include "formats/asset/payload.h"
#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/mesh/shared_borders.h"

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

Error no_such_slice(const std::string& name, int index, std::size_t slices, int first, int last) {
  return refused(name + ": slice " + std::to_string(index) + ": the asset has no such slice" +
                 (slices == 0
                      ? std::string(" (it has none)")
                      : " (it has " + std::to_string(first) + " to " + std::to_string(last) + ")"));
}

Result<AssetSlice> read_slice(ByteSource& source, const IndexedFile& file,
                              const EntryRecord& record, const Lattice& lattice,
                              const Eigen::Affine3d& frame) {
  const auto bytes = read_slice_bytes(source, file, record);
  if (!bytes) return bytes.error();
  const auto node = parse_json_text(bytes->node);
  if (!node) return node.error();
  const auto entry = entry_of_node(*node, lattice);
  if (!entry) return entry.error();
  AssetSlice geometry;
  std::int32_t z = 0;
  if (!record.is_empty()) {
    const auto decoded = decode_slice_geometry(bytes->draco, geometry);
    if (!decoded) return decoded.error();
    z = decoded->z;
  }
  auto slice = slice_of_entry(*entry, record.index, record.material, frame, lattice.to_mm(z));
  if (!slice) return slice;
  slice->mesh = std::move(geometry.mesh);
  slice->pslg = std::move(geometry.pslg);
  slice->hu = std::move(geometry.hu);
  return slice;
}

Result<AssetPart> read_by_index(ByteSource& source, const IndexedFile& file,
                                const std::vector<int>& slice_indices, const std::string& name) {
  const IndexHeader& header = file.header;
  AssetPart part;
  const auto text = read_document_texts(source, file);
  if (!text) return refused(name + ": " + text.error().message);
  const auto extras = parse_json_text(text->extras);
  if (!extras) return refused(name + ": " + extras.error().message);
  if (const auto ok = read_document_extras(*extras, part.asset, name).into(part.asset_slices); !ok)
    return ok.error();
  const auto node = parse_json_text(text->frame);
  const auto frame =
      node ? transform_of_node(*node, part.asset.lattice) : Result<Eigen::Affine3d>(node.error());
  if (!frame) return refused(name + ": " + frame.error().message);
  for (const int index : slice_indices) {
    const auto records = find_records(source, file, index);
    if (!records) return refused(name + ": " + records.error().message);
    if (records->empty())
      return no_such_slice(name, index, header.entries, header.first_index, header.last_index);
    for (const EntryRecord& record : *records) {
      auto slice = record.material < part.asset.materials.size()
                       ? read_slice(source, file, record, part.asset.lattice, *frame)
                       : refused("the slice index names a material that is not there");
      if (!slice)
        return refused(name + ": slice " + std::to_string(index) + ": " + slice.error().message);
      part.asset.slices.push_back(std::move(*slice));
    }
  }
  const auto volumes = hu_sections(trocar_extras(*extras), part.asset.lattice);
  if (!volumes) return refused(name + ": " + volumes.error().message);
  if (auto ok =
          read_hu_volumes(source, file.binary_at, header.binary_bytes, *volumes, false, part.asset);
      !ok)
    return refused(name + ": " + ok.error().message);
  return part;
}

Result<AssetPart> read_whole(ByteSource& source, const std::vector<int>& slice_indices,
                             const std::string& name) {
  std::vector<std::uint8_t> glb(static_cast<std::size_t>(source.size()));
  if (auto ok = source.read(0, glb); !ok) return refused(name + ": " + ok.error().message);
  auto asset = decode_asset(glb, name, {false, slice_indices});
  if (!asset) return asset.error();
  AssetPart part;
  part.asset_slices = slice_count(*asset);
  std::vector<AssetSlice> all = std::exchange(asset->slices, {});
  part.asset = std::move(*asset);
  for (const int index : slice_indices) {
    auto found = std::find_if(all.begin(), all.end(),
                              [index](const AssetSlice& slice) { return slice.index == index; });
    if (found == all.end())
      return no_such_slice(name, index, all.size(), all.empty() ? 0 : all.front().index,
                           all.empty() ? 0 : all.back().index);
    for (; found != all.end() && found->index == index; ++found)
      part.asset.slices.push_back(std::move(*found));
  }
  return part;
}

Result<AssetPart> read_part(ByteSource& source, std::vector<int> slice_indices,
                            const std::string& name) {
  std::sort(slice_indices.begin(), slice_indices.end());
  slice_indices.erase(std::unique(slice_indices.begin(), slice_indices.end()), slice_indices.end());
  if (source.size() > std::numeric_limits<std::uint32_t>::max())
    return refused(name + ": larger than a .glb can be");
  const auto index = find_index(source);
  if (!index) return refused(name + ": " + index.error().message);
  auto part = *index ? read_by_index(source, **index, slice_indices, name)
                     : read_whole(source, slice_indices, name);
  if (!part) return part;
  part->file_bytes = source.size();
  part->read_bytes = source.bytes_read();
  return part;
}

// The materials of one slice must lie in one plane and must not overlap.
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

std::vector<float> mean_of_welded(std::span<const AssetSlice> materials,
                                  const WeldedRegions& welded) {
  std::vector<double> sum(welded.mesh.vertices.size());
  std::vector<int> count(sum.size());
  for (std::size_t k = 0; k < materials.size(); ++k) {
    if (materials[k].hu.size() != materials[k].mesh.vertices.size()) return {};
    for (std::size_t v = 0; v < materials[k].hu.size(); ++v) {
      sum[welded.vertex[k][v]] += static_cast<double>(materials[k].hu[v]);
      ++count[welded.vertex[k][v]];
    }
  }
  std::vector<float> out;
  for (std::size_t v = 0; v < sum.size(); ++v)
    out.push_back(static_cast<float>(sum[v] / count[v]));
  return out;
}

std::optional<double> mean_by_area(std::span<const AssetSlice> materials) {
  double sum = 0, area = 0;
  for (const AssetSlice& one : materials) {
    const std::optional<double> mean = mean_hu_of(one);
    if (!mean) return std::nullopt;
    const auto weight = static_cast<double>(doubled_area(one.mesh));
    sum += weight * *mean;
    area += weight;
  }
  return area > 0 ? std::optional(sum / area) : std::nullopt;
}

Result<AssetSlice> welded(std::span<const AssetSlice> materials) {
  std::vector<Pslg> outlines;
  std::vector<const SliceMesh*> meshes;
  for (const AssetSlice& one : materials) {
    if (one.T_lps_plane.matrix() != materials[0].T_lps_plane.matrix() ||
        one.z_mm != materials[0].z_mm)
      return refused("its materials lie in different planes");
    if (auto ok = check_mesh_against_pslg(one.mesh, one.pslg); !ok) return ok.error();
    outlines.push_back(one.pslg);
    meshes.push_back(&one.mesh);
  }
  auto outline = check_shared_borders(outlines, outlines);
  if (!outline) return refused("its materials: " + outline.error().message);
  auto made = weld_regions(meshes);
  if (!made) return made.error();
  AssetSlice out;
  out.index = materials[0].index;
  out.z_mm = materials[0].z_mm;
  out.T_lps_plane = materials[0].T_lps_plane;
  out.pslg = std::move(*outline);
  out.hu = mean_of_welded(materials, *made);
  if (const auto mean = mean_by_area(materials); mean)
    out.measures_json = json_text(nlohmann::json{{"mean_hu", *mean}});
  out.mesh = std::move(made->mesh);
  return out;
}

// HU of a triangle: the mean at its centroid and half-way from there to its corners. NaN if unknown.
double mean_in(const HuPlane& plane, const Lattice& lattice,
               const std::array<LatticePoint, 3>& corners) {
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();
  for (const LatticePoint p : corners)
    centroid += Eigen::Vector2d(lattice.to_mm(p.x), lattice.to_mm(p.y)) / 3;
  auto sum = static_cast<double>(plane.at(centroid.x(), centroid.y()));
  for (const LatticePoint p : corners) {
    const Eigen::Vector2d at =
        (centroid + Eigen::Vector2d(lattice.to_mm(p.x), lattice.to_mm(p.y))) / 2;
    sum += static_cast<double>(plane.at(at.x(), at.y()));
  }
  return sum / 4;
}

std::vector<float> hu_at_vertices(const SliceMesh& mesh, const HuPlane& plane,
                                  const Lattice& lattice) {
  std::vector<double> sum(mesh.vertices.size(), 0), area(mesh.vertices.size(), 0);
  for (const Triangle& t : mesh.triangles) {
    const std::array<LatticePoint, 3> corners{mesh.vertices[t[0]], mesh.vertices[t[1]],
                                              mesh.vertices[t[2]]};
    const double hu = mean_in(plane, lattice, corners);
    const auto weight = static_cast<double>(orient2d(corners[0], corners[1], corners[2]));
    if (std::isnan(hu)) continue;
    for (const std::uint32_t v : t) {
      sum[v] += weight * hu;
      area[v] += weight;
    }
  }
  std::vector<float> out;
  for (std::size_t v = 0; v < sum.size(); ++v)
    out.push_back(area[v] > 0 ? static_cast<float>(sum[v] / area[v]) : 0.0F);
  return out;
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

Result<AssetSizes> asset_sizes(std::span<const std::uint8_t> glb, const std::string& name) {
  const auto document = parse_gltf(glb, name);
  if (!document) return document.error();
  const tinygltf::Model& model = document->model;
  AssetSizes out;
  MemorySource source(glb);
  out.json_bytes = *json_bytes_of(source);  // cannot fail: the container was parsed
  const auto index = find_index(source);
  if (index && *index) out.index_bytes = (*index)->bytes();
  if (const auto volumes = hu_sections(trocar_extras(document->extras), {}); volumes) {
    for (const HuSection& volume : *volumes) {
      const auto bytes = view_bytes(model, static_cast<int>(volume.view));
      if (bytes) out.hu_bytes += bytes->size();
    }
  }
  std::vector<bool> is_surface(model.meshes.size(), false);
  for (const std::size_t node : surface_nodes(*document)) {
    const int mesh = model.nodes[node].mesh;
    if (mesh >= 0 && static_cast<std::size_t>(mesh) < is_surface.size())
      is_surface[static_cast<std::size_t>(mesh)] = true;
  }
  for (std::size_t m = 0; m < model.meshes.size(); ++m) {
    for (const tinygltf::Primitive& primitive : model.meshes[m].primitives) {
      if (primitive.extensions.contains(kDracoExtension)) {
        const auto draco = draco_primitive(model, primitive);
        if (!draco) continue;
        (is_surface[m] ? out.surface_bytes : out.triangle_bytes) += draco->payload.size();
        if (!is_surface[m]) out.triangles += draco->triangles;
        continue;
      }
      for (const auto* accessor : {element_at(model.accessors, primitive.indices),
                                   attribute_of(model, primitive, "POSITION")}) {
        const auto bytes =
            accessor == nullptr ? std::nullopt : view_bytes(model, accessor->bufferView);
        if (bytes) out.outline_bytes += bytes->size();
      }
    }
  }
  return out;
}

Result<AssetPart> read_asset_part(const std::filesystem::path& file,
                                  std::vector<int> slice_indices) {
  const auto source = open_file(file);
  if (!source) return source.error();
  return read_part(**source, std::move(slice_indices), file.string());
}

Result<AssetPart> decode_asset_part(std::span<const std::uint8_t> glb, const std::string& name,
                                    std::vector<int> slice_indices) {
  MemorySource source(glb);
  return read_part(source, std::move(slice_indices), name);
}

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
  const auto wrong = [&name](const AssetSlice& slice, const std::string& why) {
    return refused(name + ": slice " + std::to_string(slice.index) + ": " + why);
  };
  for (const AssetSlice& slice : asset.slices) {
    if (slice.mesh.triangles.empty() && slice.pslg.rings.empty()) continue;
    if (auto ok = check_mesh_against_pslg(slice.mesh, slice.pslg); !ok)
      return wrong(slice, ok.error().message);
    if (!slice.hu.empty() && slice.hu.size() != slice.mesh.vertices.size())
      return wrong(slice, "not an HU for each vertex");
    const Eigen::Matrix3d L = slice.T_lps_plane.linear();
    if (!((L.transpose() * L - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-4) ||
        L.determinant() < 0)
      return wrong(slice, "its plane's frame is not a rotation");
  }
  for (std::size_t i = 0; i < asset.slices.size(); i += materials_of_slice(asset, i).size()) {
    const auto materials = materials_of_slice(asset, i);
    if (materials.size() < 2) continue;
    if (auto ok = verify_together(materials); !ok) return wrong(materials[0], ok.error().message);
  }
  for (const AssetSurface& one : asset.surfaces) {
    if (auto ok = check_triangle_surface(one.surface); !ok)
      return refused(name + ": surface of material " + std::to_string(one.material) + ": " +
                     ok.error().message);
  }
  return {};
}

void add_hu_at_vertices(Asset& asset) {
  for (AssetSlice& slice : asset.slices) {
    const HuPlane* const plane = asset.hu.find(slice.index);
    if (plane != nullptr && slice.hu.empty())
      slice.hu = hu_at_vertices(slice.mesh, *plane, asset.lattice);
  }
}

Result<void> weld_materials(Asset& asset, const std::string& name) {
  if (slice_count(asset) == asset.slices.size()) return {};
  // All slices are joined before the asset is changed, because a later one may be refused.
  std::vector<AssetSlice> slices;
  std::vector<std::size_t> unchanged;
  for (std::size_t i = 0; i < asset.slices.size();) {
    const std::span<const AssetSlice> materials = materials_of_slice(asset, i);
    if (materials.size() == 1) {
      unchanged.push_back(i);
    } else {
      auto one = welded(materials);
      if (!one)
        return refused(name + ": slice " + std::to_string(asset.slices[i].index) + ": " +
                       one.error().message);
      slices.push_back(std::move(*one));
    }
    i += materials.size();
  }
  for (const std::size_t i : unchanged)
    slices.push_back(std::move(asset.slices[i]));
  std::sort(slices.begin(), slices.end(),
            [](const AssetSlice& a, const AssetSlice& b) { return a.index < b.index; });
  for (AssetSlice& slice : slices)
    slice.material = 0;
  asset.slices = std::move(slices);
  asset.materials = {{"material", {}}};
  return {};
}

}  // namespace trocar
