// SPDX-License-Identifier: Apache-2.0
// Assembles the file: nodes, extras and slice index around the encoded slices.
#include <algorithm>
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
#include "formats/asset/gltf.h"
#include "formats/asset/hu_codec.h"
#include "formats/asset/payload.h"
#include "formats/base/json.h"

namespace trocar {
namespace {

using nlohmann::json;

// How the file states an entry's plane: its node's transform, and the height of its vertices.
struct EntryPlane {
  std::optional<Eigen::Affine3d> transform;  ///< mm; none: the identity
  std::int32_t z = 0;                        ///< steps
};
struct EntryPlanes {
  Eigen::Affine3d frame = Eigen::Affine3d::Identity();
  std::vector<EntryPlane> entries;
};

// The shortest text that gives every plane bit for bit. Usually the planes are parallel and their
// origins lie above each other. Then the first plane is the frame, and each other plane is moved
// along z: by its vertices if z is a whole number of lattice steps, else by its node. If the planes
// differ otherwise, each node has its own transform.
EntryPlanes entry_planes(const std::vector<EncodedSlice>& slices, const Lattice& lattice) {
  EntryPlanes out;
  if (slices.empty()) return out;
  out.frame = slices[0].T_lps_plane;
  const Eigen::Vector3d normal = out.frame.linear().col(2);
  for (const EncodedSlice& slice : slices) {
    const double z_mm = normal.dot(slice.T_lps_plane.translation() - out.frame.translation());
    EntryPlane plane;
    Eigen::Affine3d along = Eigen::Affine3d::Identity();
    const double z = z_mm / lattice.step_mm();
    if (slice.triangles > 0 && z == std::rint(z) && std::abs(z) <= kMaxAssetCoordinate) {
      plane.z = static_cast<std::int32_t>(z);
    } else if (z != 0) {
      along.translation().z() = z_mm;
      plane.transform = along;
    }
    const Eigen::Affine3d read = plane_of(out.frame, along, lattice.to_mm(plane.z));
    if (read.matrix() != slice.T_lps_plane.matrix()) {
      EntryPlanes each;
      for (const EncodedSlice& other : slices)
        each.entries.push_back({other.T_lps_plane, 0});
      return each;
    }
    out.entries.push_back(plane);
  }
  return out;
}

// Writes the slice index into the bytes that were reserved for it. `nodes` has each record's node.
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

// The three nodes above those of the entries (payload.h).
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

// The mean HU that the file states, in tenths.
std::optional<double> stated_mean_hu(const EncodedSlice& slice) {
  const json measures = parse_known_json(slice.measures_json);
  const auto mean_hu = measures.find("mean_hu");
  if (mean_hu == measures.end() || !mean_hu->is_number()) return std::nullopt;
  return std::rint(mean_hu->get<double>() * 10) / 10;
}

bool states_z(const EncodedSlice& slice) {
  return slice.z_mm != z_of_plane(slice.T_lps_plane);
}

// Entries first to first + count - 1 share one node: consecutive slices of one material in one
// frame. Sharing saves text: a node and its mesh take a tenth of a small slice's text.
struct NodeEntries {
  std::size_t first = 0, count = 0;
};
std::vector<NodeEntries> node_entries(const std::vector<EncodedSlice>& slices,
                                      const std::vector<EntryPlane>& planes) {
  const auto is_plain = [&](std::size_t i) {
    return slices[i].triangles > 0 && !planes[i].transform && !states_z(slices[i]);
  };
  std::vector<NodeEntries> out;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const bool joins =
        i > 0 && out.back().count < kMaxNodeEntries && is_plain(i - 1) && is_plain(i) &&
        slices[i].index == std::int64_t{slices[i - 1].index} + 1 &&
        slices[i].material == slices[i - 1].material &&
        stated_mean_hu(slices[i]).has_value() == stated_mean_hu(slices[i - 1]).has_value();
    if (joins)
      ++out.back().count;
    else
      out.push_back({i, 1});
  }
  return out;
}

// The extras of the node that these entries share.
json node_extras(std::span<const EncodedSlice> entries, std::int64_t expected_index) {
  json out = json::object();
  const EncodedSlice& first = entries.front();
  if (states_z(first)) out["z_mm"] = number(first.z_mm);
  json mean_hu = json::array();
  for (const EncodedSlice& entry : entries) {
    if (const auto mean = stated_mean_hu(entry)) mean_hu.push_back(number(*mean));
  }
  // A reader of one slice needs the first index to find its element of mean_hu.
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
  std::size_t distinct = 0;
  for (std::size_t i = 0; i < slices.size(); ++i)
    distinct += i == 0 || slices[i].index != slices[i - 1].index ? 1 : 0;
  json out = {
      {"schema", kAssetSchema},       {"lattice_bits", head.lattice.bits},   {"slices", distinct},
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

// The volume's planes, compressed again. Errors: (bug) a plane that is not stored as its slice's
// outlines say.
Result<EncodedHuVolume> encode_hu_volume(const HuVolume& volume, const Asset& asset) {
  EncodedHuVolume out{volume.grid, {}};
  for (const HuPlane& plane : volume.planes) {
    std::vector<const Pslg*> outlines;
    for (const AssetSlice& slice : asset.slices) {
      if (slice.index == plane.index) outlines.push_back(&slice.pslg);
    }
    const auto mask = hu_mask(volume.grid, asset.lattice, outlines);
    if (!mask) return mask.error();
    if (mask->first_column != plane.first_column || mask->first_row != plane.first_row ||
        mask->columns != plane.columns || mask->rows != plane.rows ||
        plane.hu.size() != mask->is_stored.size())
      return bug("HU of slice " + std::to_string(plane.index) + ": not those of its outlines");
    const auto value = [&plane](int column, int row) {
      return plane.hu[static_cast<std::size_t>(row - plane.first_row) *
                          static_cast<std::size_t>(plane.columns) +
                      static_cast<std::size_t>(column - plane.first_column)];
    };
    out.planes.push_back({plane.index, encode_hu_plane(volume.grid, *mask, value)});
  }
  return out;
}

}  // namespace

Result<void> check_entry_count(std::size_t entries) {
  if (entries <= kMaxSlices) return {};
  return refused(std::to_string(entries) +
                 " meshes, one for each material of each slice; an asset holds at most " +
                 std::to_string(kMaxSlices) +
                 "; mesh fewer slices at a time, or join labels to one material");
}

Result<std::vector<std::uint8_t>> assemble_asset(const Asset& head,
                                                 std::vector<EncodedSlice> slices,
                                                 AssetSizes* sizes,
                                                 const std::vector<EncodedHuVolume>& hu) {
  json parameters = parse_json(head.parameters_json);
  if (parameters.is_discarded()) return bug("the asset's parameters are not JSON");
  if (auto ok = check_entry_count(slices.size()); !ok) return ok.error();
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
  const EntryPlanes planes = entry_planes(slices, head.lattice);
  const std::vector<NodeEntries> nodes = node_entries(slices, planes.entries);
  add_top_nodes(gltf, nodes.size(), planes.frame, head.lattice);
  json extras = document_extras(head, std::move(parameters), slices);
  int meshes = 0;
  std::int64_t expected_index = 0;
  std::vector<std::size_t> record_nodes;
  for (const auto& [first, count] : nodes) {
    json node = json::object(), primitives = json::array();
    if (const auto& transform = planes.entries[first].transform)
      put_transform(*transform, head.lattice, node);
    if (json extras_of_node = node_extras(std::span(slices).subspan(first, count), expected_index);
        !extras_of_node.empty())
      node["extras"]["trocar"] = std::move(extras_of_node);
    for (std::size_t i = first; i < first + count; ++i) {
      EncodedSlice slice = std::move(slices[i]);
      EntryRecord& record = records[i];
      record.index = slice.index;
      expected_index = std::int64_t{slice.index} + 1;
      if (slice.triangles == 0) continue;
      const std::int32_t z = planes.entries[i].z;
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
  for (const EncodedHuVolume& volume : hu) {
    json element = add_hu_volume(gltf, volume);
    counted.hu_bytes += element["byteLength"].get<std::uint64_t>();
    extras["trocar"]["hu_volumes"].push_back(std::move(element));
  }
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
  std::vector<EncodedHuVolume> volumes;
  for (const HuVolume* volume : {&asset.hu, &asset.context}) {
    if (volume->planes.empty()) continue;
    auto encoded = encode_hu_volume(*volume, asset);
    if (!encoded) return encoded.error();
    volumes.push_back(std::move(*encoded));
  }
  return assemble_asset(asset, std::move(slices), sizes, volumes);
}

}  // namespace trocar
