// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/draco_mesh.h"
#include "formats/asset/gltf_writer.h"
#include "formats/asset/slice_payload.h"
#include "formats/asset/surface_payload.h"
#include "formats/geometry/mesh_validity.h"

namespace trocar {
namespace {

using nlohmann::json;

// glTF's numbers for component types and primitive modes.
constexpr int kUnsignedByte = 5121, kShort = 5122, kUnsignedShort = 5123, kUnsignedInt = 5125,
              kFloat = 5126;
constexpr int kLines = 1;  // triangles, 4, are the default
constexpr const char* kUnlitExtension = "KHR_materials_unlit";

// Whole numbers without a fraction: the text is shorter.
json number(double value) {
  constexpr double kExact = 9007199254740992.0;  // 2^53
  if (value == std::rint(value) && std::abs(value) < kExact)
    return static_cast<std::int64_t>(value);
  return value;
}

json numbers(const double* begin, std::size_t count) {
  json out = json::array();
  for (std::size_t i = 0; i < count; ++i)
    out.push_back(number(begin[i]));
  return out;
}

// The accessor of positions, in lattice steps, which are exact in float32.
json positions(std::size_t count, const LatticeBox& box, std::int32_t z) {
  return {{"componentType", kFloat},
          {"type", "VEC3"},
          {"count", count},
          {"min", {box.low.x, box.low.y, z}},
          {"max", {box.high.x, box.high.y, z}}};
}

// Where an entry is: its node's transform, and the z of its vertices.
struct Place {
  std::optional<Eigen::Affine3d> transform;  ///< mm; none: the identity
  std::int32_t z = 0;                        ///< steps
};
struct Places {
  Eigen::Affine3d frame = Eigen::Affine3d::Identity();
  std::vector<Place> entries;
};

// The shortest text that gives every plane bit for bit. Mostly the planes are parallel, and their
// origins above each other: then the frame is the first plane, and the others are moved along z, by
// their vertices if z is a lattice multiple. Else each node has its own transform.
Places places_of(const std::vector<EncodedSlice>& slices, const Lattice& lattice) {
  Places out;
  if (slices.empty()) return out;
  out.frame = slices[0].T_lps_plane;
  const Eigen::Vector3d normal = out.frame.linear().col(2);
  for (const EncodedSlice& slice : slices) {
    const double z_mm = normal.dot(slice.T_lps_plane.translation() - out.frame.translation());
    Place place;
    Eigen::Affine3d along = Eigen::Affine3d::Identity();
    const double z = z_mm / lattice.step_mm();
    if (slice.triangles > 0 && z == std::rint(z) && std::abs(z) <= kMaxAssetExtent) {
      place.z = static_cast<std::int32_t>(z);
    } else if (z != 0) {
      along.translation().z() = z_mm;
      place.transform = along;
    }
    const Eigen::Affine3d read = plane_of(out.frame, along, lattice.to_mm(place.z));
    if (read.matrix() != slice.T_lps_plane.matrix()) {
      Places each;
      for (const EncodedSlice& other : slices)
        each.entries.push_back({other.T_lps_plane, 0});
      return each;
    }
    out.entries.push_back(place);
  }
  return out;
}

void put_transform(const Eigen::Affine3d& T, const Lattice& lattice, json& node) {
  Eigen::Affine3d steps = T;
  steps.translation() /= lattice.step_mm();
  if (T.linear() != Eigen::Matrix3d::Identity())
    node["matrix"] = numbers(steps.matrix().data(), 16);  // Eigen and glTF are both column-major
  else if (!T.translation().isZero(0))
    node["translation"] = numbers(steps.translation().data(), 3);
}

json triangles_primitive(GltfWriter& gltf, const EncodedSlice& slice, std::int32_t z,
                         AssetSizes& sizes, EntryRecord& record) {
  sizes.triangles += slice.triangles;
  sizes.triangle_bytes += slice.draco.size();
  json attributes = {{"POSITION", gltf.add_accessor(positions(slice.vertices, slice.bounds, z))}};
  json ids = {{"POSITION", kDracoPositionId}};
  const int indices = gltf.add_accessor(
      {{"componentType", kUnsignedInt}, {"type", "SCALAR"}, {"count", slice.triangles * 3}});
  if (slice.has_hu) {
    attributes[kHuAttribute] = gltf.add_accessor(
        {{"componentType", kShort}, {"type", "SCALAR"}, {"count", slice.vertices}});
    ids[kHuAttribute] = kDracoHuId;
  }
  if (slice.has_colours) {
    attributes[kColourAttribute] = gltf.add_accessor({{"componentType", kUnsignedByte},
                                                      {"normalized", true},
                                                      {"type", "VEC3"},
                                                      {"count", slice.vertices}});
    ids[kColourAttribute] = kDracoColourId;
  }
  const auto [view, range] =
      gltf.add_view(slice.draco.data(), slice.draco.size(), GltfWriter::kNoTarget);
  record.draco_offset = static_cast<std::uint32_t>(range.offset);
  record.draco_bytes = static_cast<std::uint32_t>(range.size);
  return {
      {"material", slice.material},
      {"attributes", std::move(attributes)},
      {"indices", indices},
      {"extensions", {{kDracoExtension, {{"bufferView", view}, {"attributes", std::move(ids)}}}}}};
}

json lines_primitive(GltfWriter& gltf, const Pslg& pslg, std::int32_t z, std::size_t material,
                     AssetSizes& sizes) {
  std::vector<LatticePoint> points;
  std::vector<std::uint32_t> indices;
  for (const Ring& ring : pslg.rings) {
    const auto first = static_cast<std::uint32_t>(points.size());
    const auto size = static_cast<std::uint32_t>(ring.size());
    for (std::uint32_t i = 0; i < size; ++i) {
      points.push_back(ring[i]);
      indices.push_back(first + i);
      indices.push_back(first + (i + 1) % size);
    }
  }
  std::vector<float> xyz;
  xyz.reserve(points.size() * 3);
  for (LatticePoint p : points) {
    for (const std::int32_t c : {p.x, p.y, z})
      xyz.push_back(static_cast<float>(c));
  }
  const auto add = [&](json accessor, const auto& data, int target) {
    const std::size_t bytes = data.size() * sizeof data[0];
    sizes.outline_bytes += bytes;
    accessor["bufferView"] = gltf.add_view(data.data(), bytes, target).number;
    return gltf.add_accessor(accessor);
  };
  json primitive = {{"mode", kLines}, {"material", material}};
  primitive["attributes"]["POSITION"] =
      add(positions(points.size(), box_around(points), z), xyz, GltfWriter::kVertices);
  json accessor = {{"type", "SCALAR"}, {"count", indices.size()}};
  const bool narrow = points.size() < 65535;
  accessor["componentType"] = narrow ? kUnsignedShort : kUnsignedInt;
  primitive["indices"] =
      narrow ? add(accessor, std::vector<std::uint16_t>(indices.begin(), indices.end()),
                   GltfWriter::kIndices)
             : add(accessor, indices, GltfWriter::kIndices);
  return primitive;
}

// The first material's colour is that of bone; the others' are far from their neighbours'.
json gltf_materials(const Asset& head) {
  constexpr std::array<std::array<double, 3>, 6> kColours{{{0.89, 0.85, 0.76},
                                                           {0.55, 0.7, 0.85},
                                                           {0.85, 0.55, 0.5},
                                                           {0.6, 0.8, 0.55},
                                                           {0.8, 0.65, 0.85},
                                                           {0.9, 0.8, 0.45}}};
  json out = json::array();
  for (const AssetMaterial& material : head.materials) {
    const auto& [r, g, b] = kColours[out.size() % kColours.size()];
    json one = {
        {"doubleSided", true},
        {"pbrMetallicRoughness", {{"baseColorFactor", {r, g, b, 1}}, {"metallicFactor", 0}}}};
    if (head.colours) {  // seen as they are: neither tinted nor shaded
      one["pbrMetallicRoughness"] = {{"metallicFactor", 0}};
      one["extensions"] = {{kUnlitExtension, json::object()}};
    }
    if (head.materials.size() > 1) one["name"] = material.name;
    out.push_back(std::move(one));
  }
  if (head.lines) {
    out.push_back({{"name", "outline"},
                   {"pbrMetallicRoughness", {{"baseColorFactor", {0.55, 0.1, 0.1, 1}}}},
                   {"extensions", {{kUnlitExtension, json::object()}}}});
  }
  return out;
}

// Writes the slice index into the bytes that were reserved for it. `nodes` has the node of each
// record.
void put_index(GltfWriter::File& file, std::vector<EntryRecord> records,
               const std::vector<std::size_t>& nodes) {
  IndexHeader header;
  header.entries = static_cast<std::uint32_t>(records.size());
  header.json_bytes = static_cast<std::uint32_t>(file.json_bytes);
  header.binary_bytes = static_cast<std::uint32_t>(file.bytes.size() - file.binary_offset);
  header.extras_offset = static_cast<std::uint32_t>(file.extras.offset);
  header.extras_bytes = static_cast<std::uint32_t>(file.extras.size);
  header.frame_offset = static_cast<std::uint32_t>(file.nodes[kFrameNode].offset);
  header.frame_bytes = static_cast<std::uint32_t>(file.nodes[kFrameNode].size);
  if (!records.empty()) {
    header.first_index = records.front().index;
    header.last_index = records.back().index;
  }
  for (std::size_t i = 0; i < records.size(); ++i) {
    const GltfWriter::Range node = file.nodes[nodes[i]];
    records[i].node_offset = static_cast<std::uint32_t>(node.offset);
    records[i].node_bytes = static_cast<std::uint16_t>(node.size);
  }
  std::uint8_t* const at = file.bytes.data() + file.binary_offset;
  std::memcpy(at, &header, sizeof header);
  if (!records.empty())
    std::memcpy(at + sizeof header, records.data(), records.size() * sizeof(EntryRecord));
  write_index_checksums(file.bytes);
}

// The three nodes above those of the entries (slice_payload.h).
void add_top_nodes(GltfWriter& gltf, std::size_t nodes, const Eigen::Affine3d& frame,
                   const Lattice& lattice) {
  // LPS in steps -> glTF metres, +Y up: (x, y, z) -> (x, z, -y).
  const double step = lattice.step_m();
  gltf.add_node({{"children", json::array({kFrameNode})},
                 {"matrix", {step, 0, 0, 0, 0, 0, -step, 0, 0, step, 0, 0, 0, 0, 0, 1}}});
  json node = {{"children", json::array({kListNode})}};
  put_transform(frame, lattice, node);
  gltf.add_node(node);
  std::vector<std::size_t> children(nodes);
  std::iota(children.begin(), children.end(), kFirstEntryNode);
  gltf.add_node(nodes > 0 ? json{{"children", children}} : json::object());
}

// The mean HU that the file states, in tenths: only without HU at the vertices.
std::optional<double> stated_mean_hu(const EncodedSlice& slice) {
  if (slice.has_hu) return std::nullopt;
  const json measures = json::parse(slice.measures_json);
  const auto mean_hu = measures.find("mean_hu");
  if (mean_hu == measures.end() || !mean_hu->is_number()) return std::nullopt;
  return std::rint(mean_hu->get<double>() * 10) / 10;
}

bool states_z(const EncodedSlice& slice) {
  return slice.z_mm != z_of_plane(slice.T_lps_plane);
}

// Entries i to i + count - 1 have one node: slices of one material that follow each other in one
// frame. A node and its mesh take a tenth of a small slice's text.
struct NodeEntries {
  std::size_t first = 0, count = 0;
};
std::vector<NodeEntries> node_entries(const std::vector<EncodedSlice>& slices,
                                      const std::vector<Place>& places) {
  const auto is_plain = [&](std::size_t i) {
    return slices[i].triangles > 0 && !places[i].transform && !states_z(slices[i]);
  };
  std::vector<NodeEntries> out;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const bool joins =
        i > 0 && out.back().count < kMaxNodeEntries && is_plain(i - 1) && is_plain(i) &&
        slices[i].index == std::int64_t{slices[i - 1].index} + 1 &&
        slices[i].material == slices[i - 1].material &&
        stated_mean_hu(slices[i]).has_value() == stated_mean_hu(slices[i - 1]).has_value();
    if (joins) {
      ++out.back().count;
    } else {
      out.push_back({i, 1});
    }
  }
  return out;
}

// What the node of these entries says beside its transform and mesh.
json node_extras(std::span<const EncodedSlice> entries, std::int64_t expected_index) {
  json out = json::object();
  const EncodedSlice& first = entries.front();
  if (states_z(first)) out["z_mm"] = number(first.z_mm);
  json mean_hu = json::array();
  for (const EncodedSlice& entry : entries) {
    if (const auto mean = stated_mean_hu(entry)) mean_hu.push_back(number(*mean));
  }
  // With the index of the first a reader of one slice finds its place in the list.
  if (first.index != expected_index || mean_hu.size() > 1) out["index"] = first.index;
  if (!mean_hu.empty()) out["mean_hu"] = std::move(mean_hu);
  return out;
}

json document_extras(const Asset& head, json parameters, const std::vector<EncodedSlice>& slices) {
  json list = json::array();
  for (const AssetMaterial& material : head.materials) {
    list.push_back({{"name", material.name}});
    if (material.label) list.back()["label"] = *material.label;
  }
  std::size_t different = 0;
  for (std::size_t i = 0; i < slices.size(); ++i)
    different += i == 0 || slices[i].index != slices[i - 1].index ? 1 : 0;
  json out = {
      {"schema", kAssetSchema},       {"lattice_bits", head.lattice.bits},   {"slices", different},
      {"materials", std::move(list)}, {"parameters", std::move(parameters)}, {"use", kAssetUse}};
  if (!head.input_key_digest.empty()) out["input_key_digest"] = head.input_key_digest;
  if (std::any_of(slices.begin(), slices.end(), [](const EncodedSlice& s) { return s.has_hu; }))
    out["hu_step"] = kHuStep;
  return {{"trocar", std::move(out)}};
}

Result<void> check_order(const Asset& head, const std::vector<EncodedSlice>& slices) {
  if (head.materials.empty()) return bug("an asset without a material");
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const EncodedSlice& slice = slices[i];
    const std::string where = "slice " + std::to_string(slice.index) + ": ";
    if (slice.material < 0 || static_cast<std::size_t>(slice.material) >= head.materials.size())
      return bug(where + "its material is not in the list");
    if (i > 0 && std::pair(slices[i - 1].index, slices[i - 1].material) >=
                     std::pair(slice.index, slice.material))
      return bug(where + "slices do not ascend by index and material");
  }
  return {};
}

// A node of the scene beside the scan's: readers of slices do not meet it. What is written is
// decoded again and proved.
Result<int> add_surface(GltfWriter& gltf, const AssetSurface& one, AssetSizes& sizes) {
  const TriangleSurface& surface = one.surface;
  const auto draco = encode_surface(surface);
  if (!draco) return draco.error();
  const auto decoded =
      decode_surface(*draco, surface.vertices.size(), surface.triangles.size(), surface.lattice);
  if (!decoded)
    return bug("the surface that Draco wrote does not decode: " + decoded.error().message);
  if (auto ok = check_triangle_surface(*decoded); !ok) return bug(ok.error().message);
  sizes.surface_bytes += draco->size();

  SpacePoint low = surface.vertices[0], high = low;
  for (const SpacePoint& p : surface.vertices) {
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], p[k]);
      high[k] = std::max(high[k], p[k]);
    }
  }
  const int position = gltf.add_accessor({{"componentType", kFloat},
                                          {"type", "VEC3"},
                                          {"count", surface.vertices.size()},
                                          {"min", low},
                                          {"max", high}});
  const int normal = gltf.add_accessor(
      {{"componentType", kFloat}, {"type", "VEC3"}, {"count", surface.vertices.size()}});
  const int indices = gltf.add_accessor({{"componentType", kUnsignedInt},
                                         {"type", "SCALAR"},
                                         {"count", surface.triangles.size() * 3}});
  const int view = gltf.add_view(draco->data(), draco->size(), GltfWriter::kNoTarget).number;
  const json ids = {{"POSITION", kDracoSurfacePositionId}, {"NORMAL", kDracoSurfaceNormalId}};
  const json primitive = {
      {"material", one.material},
      {"attributes", {{"POSITION", position}, {"NORMAL", normal}}},
      {"indices", indices},
      {"extensions", {{kDracoExtension, {{"bufferView", view}, {"attributes", ids}}}}}};
  const int mesh = gltf.add_mesh({{"primitives", json::array({primitive})}});
  return gltf.add_node({{"mesh", mesh},
                        {"matrix", surface_matrix(surface.lattice)},
                        {"extras",
                         {{"trocar",
                           {{"surface", one.material},
                            {"lattice_bits", surface.lattice.bits},
                            {"distance_mm", one.distance_mm}}}}}});
}

}  // namespace

Result<DracoGrid> asset_grid(const Lattice& lattice, const LatticeBox& box) {
  const auto [low, high] = box;
  const std::int64_t extent = std::max(std::int64_t{high.x} - low.x, std::int64_t{high.y} - low.y);
  const std::int64_t farthest =
      std::max({std::abs(std::int64_t{low.x}), std::abs(std::int64_t{low.y}),
                std::abs(std::int64_t{high.x}), std::abs(std::int64_t{high.y})});
  DracoGrid grid{lattice, low, 1};
  const std::int64_t span =
      std::max(std::int64_t{high.x} - grid.origin.x, std::int64_t{high.y} - grid.origin.y);
  if (std::max({extent, farthest, span}) > kMaxAssetExtent) {
    return refused("the slices span " + std::to_string(std::max(extent, farthest)) +
                   " lattice steps; an asset holds " + std::to_string(kMaxAssetExtent) +
                   " (use a coarser lattice)");
  }
  while ((std::int64_t{1} << grid.quantization_bits) - 1 < span)
    ++grid.quantization_bits;
  return grid;
}

Result<EncodedSlice> encode_slice(const AssetSlice& slice, const DracoGrid& grid) {
  if (slice.mesh.triangles.empty()) return encode_slice(slice, {}, grid);
  const auto outline = ProvedOutline::of(slice.pslg);
  if (!outline) return bug("slice " + std::to_string(slice.index) + ": " + outline.error().message);
  return encode_slice(slice, *outline, grid);
}

// Counts, bounds and proofs are those of the bytes just written, decoded again.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const ProvedOutline& outline,
                                  const DracoGrid& grid) {
  const std::string where = "slice " + std::to_string(slice.index) + ": ";
  if (!json::parse(slice.measures_json, nullptr, false).is_object())
    return bug(where + "its measures are not a JSON object");
  EncodedSlice out;
  out.index = slice.index;
  out.z_mm = slice.z_mm;
  out.T_lps_plane = slice.T_lps_plane;
  out.measures_json = slice.measures_json;
  out.material = slice.material;
  if (slice.mesh.triangles.empty()) return out;
  out.has_hu = !slice.hu.empty();
  out.has_colours = grid.colours && out.has_hu;
  auto bytes = encode_draco(slice.mesh, grid, slice.hu);
  if (!bytes) return bug(where + bytes.error().message);
  AssetSlice decoded;
  if (const auto ok = decode_slice_geometry(*bytes, decoded); !ok)
    return bug(where + "the bytes that Draco wrote do not decode: " + ok.error().message);
  const auto& [vertices, triangles] = decoded.mesh;
  if (vertices.size() != slice.mesh.vertices.size() ||
      triangles.size() != slice.mesh.triangles.size() || decoded.hu.size() != slice.hu.size()) {
    return bug(where + "Draco did not keep every vertex and triangle");
  }
  if (auto ok = check_mesh_against_outline(decoded.mesh, outline); !ok) {
    return bug(where + ok.error().message);
  }
  out.pslg = std::move(decoded.pslg);
  const auto z_at = draco_z_at(*bytes, grid);
  if (!z_at) return bug(where + z_at.error().message);
  out.draco_z_at = *z_at;
  out.draco = std::move(*bytes);
  out.vertices = vertices.size();
  out.triangles = triangles.size();
  out.bounds = box_around(vertices);
  return out;
}

Result<std::vector<std::uint8_t>> assemble_asset(const Asset& head,
                                                 std::vector<EncodedSlice> slices,
                                                 AssetSizes* sizes) {
  json parameters = json::parse(head.parameters_json, nullptr, false);
  if (parameters.is_discarded()) return bug("the asset's parameters are not JSON");
  if (auto ok = check_order(head, slices); !ok) return ok.error();
  GltfWriter gltf;
  AssetSizes counted;
  std::size_t bytes = 4096;
  for (const EncodedSlice& slice : slices) {
    bytes += slice.draco.size() + 1024;  // 1024 for its JSON
    if (!head.lines) continue;
    for (const Ring& ring : slice.pslg.rings)
      bytes += ring.size() * (3 * sizeof(float) + 2 * sizeof(std::uint32_t)) + 6;
  }
  // The index is at the start (asset_index.h). Its bytes are reserved here and written last.
  std::vector<EntryRecord> records(slices.size());
  counted.index_bytes = sizeof(IndexHeader) + records.size() * sizeof(EntryRecord);
  gltf.reserve(bytes + counted.index_bytes);
  gltf.add_bytes(std::vector<std::uint8_t>(counted.index_bytes));
  const Places places = places_of(slices, head.lattice);
  const std::vector<NodeEntries> nodes = node_entries(slices, places.entries);
  add_top_nodes(gltf, nodes.size(), places.frame, head.lattice);
  json extras = document_extras(head, std::move(parameters), slices);
  int meshes = 0;
  std::int64_t expected_index = 0;
  std::vector<std::size_t> record_nodes;
  for (const auto& [first, count] : nodes) {
    json node = json::object(), primitives = json::array();
    if (const auto& transform = places.entries[first].transform)
      put_transform(*transform, head.lattice, node);
    if (json said = node_extras(std::span(slices).subspan(first, count), expected_index);
        !said.empty())
      node["extras"]["trocar"] = std::move(said);
    for (std::size_t i = first; i < first + count; ++i) {
      EncodedSlice slice = std::move(slices[i]);
      EntryRecord& record = records[i];
      record.index = slice.index;
      expected_index = std::int64_t{slice.index} + 1;
      if (slice.triangles == 0) continue;
      const std::int32_t z = places.entries[i].z;
      const auto stored_z = static_cast<float>(z);
      std::memcpy(slice.draco.data() + slice.draco_z_at, &stored_z, sizeof stored_z);
      record.material = static_cast<std::uint16_t>(slice.material);
      primitives.push_back(triangles_primitive(gltf, slice, z, counted, record));
      if (head.lines)
        primitives.push_back(lines_primitive(gltf, slice.pslg, z, head.materials.size(), counted));
    }
    if (!primitives.empty()) {
      gltf.add_mesh({{"primitives", std::move(primitives)}});
      node["mesh"] = meshes++;
    }
    record_nodes.insert(record_nodes.end(), count, static_cast<std::size_t>(gltf.add_node(node)));
  }
  json scene = json::array({0});
  for (const AssetSurface& surface : head.surfaces) {
    const auto node = add_surface(gltf, surface, counted);
    if (!node) return node.error();
    scene.push_back(*node);
  }
  json used = json::array({kDracoExtension});
  if (head.lines || head.colours) used.push_back(kUnlitExtension);
  auto file =
      std::move(gltf).finish({{"asset", {{"version", "2.0"}, {"generator", head.generator}}},
                              {"extensionsUsed", std::move(used)},
                              {"extensionsRequired", json::array({kDracoExtension})},
                              {"materials", gltf_materials(head)},
                              {"scene", 0},
                              {"scenes", json::array({{{"nodes", std::move(scene)}}})}},
                             extras);
  if (!file) return file.error();
  put_index(*file, std::move(records), record_nodes);
  counted.json_bytes = file->json_bytes;
  if (sizes != nullptr) *sizes = counted;
  return std::move(file->bytes);
}

Result<std::vector<std::uint8_t>> encode_asset(const Asset& asset, AssetSizes* sizes) {
  constexpr std::int32_t kMax = std::numeric_limits<std::int32_t>::max();
  LatticeBox box{{kMax, kMax}, {-kMax, -kMax}};
  for (const AssetSlice& slice : asset.slices)
    widen(box, slice.mesh.vertices);
  if (box.low.x > box.high.x) box = {};
  auto grid = asset_grid(asset.lattice, box);
  if (!grid) return grid.error();
  grid->colours = asset.colours;
  std::vector<EncodedSlice> slices;
  for (const AssetSlice& slice : asset.slices) {
    auto encoded = encode_slice(slice, *grid);
    if (!encoded) return encoded.error();
    slices.push_back(std::move(*encoded));
  }
  return assemble_asset(asset, std::move(slices), sizes);
}

}  // namespace trocar
