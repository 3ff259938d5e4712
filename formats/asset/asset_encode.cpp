// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/draco_mesh.h"
#include "formats/asset/gltf_writer.h"
#include "formats/asset/surface_payload.h"
#include "formats/geometry/mesh_validity.h"

namespace trocar {
namespace {

using nlohmann::json;

// glTF's numbers for component types and primitive modes.
constexpr int kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126;
constexpr int kLines = 1, kTriangles = 4;
constexpr const char* kUnlitExtension = "KHR_materials_unlit";

// The accessor of positions. glTF requires the bounds of the float32 values; lattice multiples are
// exact in float32.
json positions(std::size_t count, const LatticeBox& box, const Lattice& lattice) {
  return {{"componentType", kFloat},
          {"type", "VEC3"},
          {"count", count},
          {"min", {lattice.to_mm(box.low.x), lattice.to_mm(box.low.y), 0.0}},
          {"max", {lattice.to_mm(box.high.x), lattice.to_mm(box.high.y), 0.0}}};
}

json triangles_primitive(GltfWriter& gltf, const EncodedSlice& slice, const Lattice& lattice,
                         AssetSizes& sizes, SliceRecord& record) {
  sizes.triangles += slice.triangles;
  sizes.triangle_bytes += slice.draco.size();
  const int position = gltf.add_accessor(positions(slice.vertices, slice.bounds, lattice));
  const int indices = gltf.add_accessor(
      {{"componentType", kUnsignedInt}, {"type", "SCALAR"}, {"count", slice.triangles * 3}});
  const auto [view, range] =
      gltf.add_view(slice.draco.data(), slice.draco.size(), GltfWriter::kNoTarget);
  record.draco_offset = static_cast<std::uint32_t>(range.offset);
  record.draco_bytes = static_cast<std::uint32_t>(range.size);
  record.vertices = static_cast<std::uint32_t>(slice.vertices);
  record.triangles = static_cast<std::uint32_t>(slice.triangles);
  record.low = slice.bounds.low;
  record.high = slice.bounds.high;
  return {{"mode", kTriangles},
          {"material", 0},
          {"attributes", {{"POSITION", position}}},
          {"indices", indices},
          {"extensions",
           {{kDracoExtension,
             {{"bufferView", view}, {"attributes", {{"POSITION", kDracoPositionId}}}}}}}};
}

json lines_primitive(GltfWriter& gltf, const Pslg& pslg, const Lattice& lattice, AssetSizes& sizes,
                     SliceRecord& record) {
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
    xyz.push_back(static_cast<float>(lattice.to_mm(p.x)));
    xyz.push_back(static_cast<float>(lattice.to_mm(p.y)));
    xyz.push_back(0.0F);
  }
  const auto add = [&](json accessor, const auto& data, int target, std::uint32_t& offset) {
    const std::size_t bytes = data.size() * sizeof data[0];
    sizes.outline_bytes += bytes;
    const auto [view, range] = gltf.add_view(data.data(), bytes, target);
    accessor["bufferView"] = view;
    offset = static_cast<std::uint32_t>(range.offset);
    return gltf.add_accessor(accessor);
  };
  record.outline_vertices = static_cast<std::uint32_t>(points.size());
  json primitive = {{"mode", kLines}, {"material", 1}};
  primitive["attributes"]["POSITION"] = add(positions(points.size(), box_around(points), lattice),
                                            xyz, GltfWriter::kVertices, record.outline_offset);
  json accessor = {{"type", "SCALAR"}, {"count", indices.size()}};
  const bool narrow = points.size() < 65535;
  record.segment_index_bytes = narrow ? 2 : 4;
  accessor["componentType"] = narrow ? kUnsignedShort : kUnsignedInt;
  primitive["indices"] =
      narrow ? add(accessor, std::vector<std::uint16_t>(indices.begin(), indices.end()),
                   GltfWriter::kIndices, record.segments_offset)
             : add(accessor, indices, GltfWriter::kIndices, record.segments_offset);
  return primitive;
}

json materials() {
  return {{{"name", "material"},
           {"doubleSided", true},
           {"pbrMetallicRoughness",
            {{"baseColorFactor", {0.89, 0.85, 0.76, 1.0}},
             {"metallicFactor", 0.0},
             {"roughnessFactor", 0.9}}}},
          {{"name", "outline"},
           {"pbrMetallicRoughness", {{"baseColorFactor", {0.55, 0.1, 0.1, 1.0}}}},
           {"extensions", {{kUnlitExtension, json::object()}}}}};
}

// Writes the slice index into the bytes that were reserved for it.
void put_index(GltfWriter::File& file, std::vector<SliceRecord> records) {
  IndexHeader header;
  header.slices = static_cast<std::uint32_t>(records.size());
  header.json_bytes = static_cast<std::uint32_t>(file.json_bytes);
  header.binary_bytes = static_cast<std::uint32_t>(file.bytes.size() - file.binary_offset);
  header.extras_offset = static_cast<std::uint32_t>(file.extras.offset);
  header.extras_bytes = static_cast<std::uint32_t>(file.extras.size);
  if (!records.empty()) {
    header.first_index = records.front().index;
    header.last_index = records.back().index;
  }
  for (std::size_t i = 0; i < records.size(); ++i) {
    const GltfWriter::Range node = file.nodes[i + 1];  // node 0 is the scan
    records[i].node_offset = static_cast<std::uint32_t>(node.offset);
    records[i].node_bytes = static_cast<std::uint32_t>(node.size);
  }
  std::uint8_t* const at = file.bytes.data() + file.binary_offset;
  std::memcpy(at, &header, sizeof header);
  if (!records.empty())
    std::memcpy(at + sizeof header, records.data(), records.size() * sizeof(SliceRecord));
  write_index_checksums(file.bytes);
}

std::vector<double> node_matrix(const Eigen::Affine3d& T) {
  const Eigen::Matrix4d& m = T.matrix();
  return {m.data(), m.data() + 16};  // Eigen and glTF are both column-major
}

json root_node(std::size_t slices) {
  std::vector<std::size_t> children(slices);
  std::iota(children.begin(), children.end(), std::size_t{1});
  // LPS mm -> glTF metres, +Y up: (x, y, z) -> (x, z, -y) / 1000.
  json node = {{"name", "scan"},
               {"matrix", {1e-3, 0, 0, 0, 0, 0, -1e-3, 0, 0, 1e-3, 0, 0, 0, 0, 0, 1}}};
  if (slices > 0) node["children"] = children;
  return node;
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
  const int mesh = gltf.add_mesh({{"name", "surface"}, {"primitives", json::array({primitive})}});
  return gltf.add_node({{"name", "surface"},
                        {"mesh", mesh},
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
  // Draco passes its options on as text with six decimals. An origin in whole mm and a range of at
  // least 16 mm are exact in it.
  const auto whole_mm = [bits = lattice.bits](std::int32_t c) {
    return static_cast<std::int32_t>((c >> bits) * (1 << bits));
  };
  DracoGrid grid{lattice, {whole_mm(low.x), whole_mm(low.y)}, std::min(24, lattice.bits + 5)};
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

// Counts, bounds and proofs are those of the bytes just written, decoded again.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const DracoGrid& grid) {
  const std::string where = "slice " + std::to_string(slice.index) + ": ";
  if (!json::accept(slice.measures_json)) return bug(where + "its measures are not JSON");
  EncodedSlice out{
      slice.index, slice.z_mm, slice.T_lps_plane, slice.pslg, slice.measures_json, {}, 0, 0, {}};
  if (slice.mesh.triangles.empty()) return out;
  auto bytes = encode_draco(slice.mesh, grid);
  if (!bytes) return bug(where + bytes.error().message);
  auto decoded =
      decode_draco(*bytes, grid.lattice, slice.mesh.vertices.size(), slice.mesh.triangles.size());
  if (!decoded)
    return bug(where + "the bytes that Draco wrote do not decode: " + decoded.error().message);
  if (decoded->vertices.size() != slice.mesh.vertices.size() ||
      decoded->triangles.size() != slice.mesh.triangles.size()) {
    return bug(where + "Draco did not keep every vertex and triangle");
  }
  if (auto ok = check_mesh_against_pslg(*decoded, slice.pslg); !ok) {
    return bug(where + ok.error().message);
  }
  out.draco = std::move(*bytes);
  out.vertices = decoded->vertices.size();
  out.triangles = decoded->triangles.size();
  out.bounds = box_around(decoded->vertices);
  return out;
}

Result<std::vector<std::uint8_t>> assemble_asset(const Asset& head,
                                                 std::vector<EncodedSlice> slices,
                                                 AssetSizes* sizes) {
  json parameters = json::parse(head.parameters_json, nullptr, false);
  if (parameters.is_discarded()) return bug("the asset's parameters are not JSON");
  GltfWriter gltf;
  AssetSizes counted;
  std::size_t bytes = 4096;
  for (const EncodedSlice& slice : slices) {
    bytes += slice.draco.size() + 2048;  // 2048 for its JSON
    for (const Ring& ring : slice.pslg.rings)
      bytes += ring.size() * (3 * sizeof(float) + 2 * sizeof(std::uint32_t)) + 6;
  }
  // The index is at the start (asset_index.h). Its bytes are reserved here and written last.
  std::vector<SliceRecord> records(slices.size());
  counted.index_bytes = sizeof(IndexHeader) + records.size() * sizeof(SliceRecord);
  gltf.reserve(bytes + counted.index_bytes);
  gltf.add_view(std::vector<std::uint8_t>(counted.index_bytes).data(), counted.index_bytes,
                GltfWriter::kNoTarget);
  gltf.add_node(root_node(slices.size()));
  int meshes = 0;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const EncodedSlice slice = std::move(slices[i]);
    SliceRecord& record = records[i];
    record.index = slice.index;
    const std::string name = "slice " + std::to_string(slice.index);
    json node = {{"name", name},
                 {"matrix", node_matrix(slice.T_lps_plane)},
                 {"extras",
                  {{"trocar",
                    {{"index", slice.index},
                     {"z_mm", slice.z_mm},
                     {"measures", json::parse(slice.measures_json)}}}}}};
    if (slice.triangles > 0) {
      json primitives = json::array();
      primitives.push_back(triangles_primitive(gltf, slice, head.lattice, counted, record));
      primitives.push_back(lines_primitive(gltf, slice.pslg, head.lattice, counted, record));
      gltf.add_mesh({{"name", name}, {"primitives", std::move(primitives)}});
      node["mesh"] = meshes++;
    }
    gltf.add_node(node);
  }
  json scene = json::array({0});
  for (const AssetSurface& surface : head.surfaces) {
    const auto node = add_surface(gltf, surface, counted);
    if (!node) return node.error();
    scene.push_back(*node);
  }
  auto file =
      std::move(gltf).finish({{"asset", {{"version", "2.0"}, {"generator", head.generator}}},
                              {"extensionsUsed", {kDracoExtension, kUnlitExtension}},
                              {"extensionsRequired", json::array({kDracoExtension})},
                              {"materials", materials()},
                              {"scene", 0},
                              {"scenes", json::array({{{"nodes", std::move(scene)}}})}},
                             {{"trocar",
                               {{"schema", kAssetSchema},
                                {"lattice_bits", head.lattice.bits},
                                {"slices", slices.size()},
                                {"parameters", std::move(parameters)},
                                {"input_digest", head.input_digest}}}});
  if (!file) return file.error();
  put_index(*file, std::move(records));
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
  const auto grid = asset_grid(asset.lattice, box);
  if (!grid) return grid.error();
  std::vector<EncodedSlice> slices;
  for (const AssetSlice& slice : asset.slices) {
    auto encoded = encode_slice(slice, *grid);
    if (!encoded) return encoded.error();
    slices.push_back(std::move(*encoded));
  }
  return assemble_asset(asset, std::move(slices), sizes);
}

}  // namespace trocar
