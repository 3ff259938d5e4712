// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "formats/asset.h"
#include "formats/draco_mesh.h"
#include "formats/gltf_writer.h"
#include "formats/mesh_validity.h"

namespace trocar {
namespace {

using nlohmann::json;

// glTF's numbers for these.
constexpr int kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126;
constexpr int kLines = 1, kTriangles = 4;
constexpr const char* kUnlitExtension = "KHR_materials_unlit";

Result<DracoGrid> common_grid(const Asset& asset) {
  constexpr std::int32_t kMax = std::numeric_limits<std::int32_t>::max();
  LatticePoint low{kMax, kMax}, high{-kMax, -kMax};
  for (const AssetSlice& slice : asset.slices) {
    for (LatticePoint p : slice.mesh.vertices) {
      low = {std::min(low.x, p.x), std::min(low.y, p.y)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y)};
    }
  }
  DracoGrid grid{asset.lattice, {0, 0}, 1};
  if (low.x > high.x) return grid;
  const std::int64_t extent = std::max(std::int64_t{high.x} - low.x, std::int64_t{high.y} - low.y);
  const std::int64_t farthest =
      std::max({std::abs(std::int64_t{low.x}), std::abs(std::int64_t{low.y}),
                std::abs(std::int64_t{high.x}), std::abs(std::int64_t{high.y})});
  if (extent > kMaxAssetExtent || farthest > kMaxAssetExtent) {
    return refused("the outline spans " + std::to_string(std::max(extent, farthest)) +
                   " lattice steps; an asset holds " + std::to_string(kMaxAssetExtent) +
                   " (use a coarser lattice)");
  }
  // Draco's options travel as text with six decimals: the origin in whole mm and a range of at
  // least 16 mm survive that exactly.
  const auto whole_mm = [bits = asset.lattice.bits](std::int32_t c) {
    return static_cast<std::int32_t>((c >> bits) * (1 << bits));
  };
  grid.origin = {whole_mm(low.x), whole_mm(low.y)};
  const std::int64_t span =
      std::max(std::int64_t{high.x} - grid.origin.x, std::int64_t{high.y} - grid.origin.y);
  grid.quantization_bits = std::min(24, asset.lattice.bits + 5);
  while ((std::int64_t{1} << grid.quantization_bits) - 1 < span)
    ++grid.quantization_bits;
  return grid;
}

struct Box {
  LatticePoint low, high;
};

Box box_of(const std::vector<LatticePoint>& points) {
  Box box{points.front(), points.front()};
  for (LatticePoint p : points) {
    box.low = {std::min(box.low.x, p.x), std::min(box.low.y, p.y)};
    box.high = {std::max(box.high.x, p.x), std::max(box.high.y, p.y)};
  }
  return box;
}

// Of positions: glTF wants the bounds of the float32 values; lattice multiples are exact in it.
json positions(std::size_t count, const Box& box, const Lattice& lattice) {
  return {{"componentType", kFloat},
          {"type", "VEC3"},
          {"count", count},
          {"min", {lattice.to_mm(box.low.x), lattice.to_mm(box.low.y), 0.0}},
          {"max", {lattice.to_mm(box.high.x), lattice.to_mm(box.high.y), 0.0}}};
}

// A slice's triangles as they will be in the file, with what glTF says about them.
struct Payload {
  std::vector<std::uint8_t> bytes;
  std::size_t vertices = 0, triangles = 0;
  Box bounds;
};

// Counts, bounds and proofs come from the bytes just written, not from what we meant to write.
Result<Payload> compress(const AssetSlice& slice, const DracoGrid& grid) {
  Payload out;
  if (slice.mesh.triangles.empty()) return out;
  const std::string where = "slice " + std::to_string(slice.index) + ": ";
  auto bytes = encode_draco(slice.mesh, grid);
  if (!bytes) return bug(where + bytes.error().message);
  auto decoded =
      decode_draco(*bytes, grid.lattice, slice.mesh.vertices.size(), slice.mesh.triangles.size());
  if (!decoded) return bug(where + "what Draco wrote does not decode: " + decoded.error().message);
  if (decoded->vertices.size() != slice.mesh.vertices.size() ||
      decoded->triangles.size() != slice.mesh.triangles.size()) {
    return bug(where + "Draco did not keep every vertex and triangle");
  }
  if (auto ok = check_mesh_against_pslg(*decoded, slice.pslg); !ok) {
    return bug(where + ok.error().message);
  }
  out.bytes = std::move(*bytes);
  out.vertices = decoded->vertices.size();
  out.bounds = box_of(decoded->vertices);
  out.triangles = decoded->triangles.size();
  return out;
}

json triangles_primitive(GltfWriter& gltf, const Payload& payload, const Lattice& lattice,
                         AssetSizes& sizes) {
  sizes.triangles += payload.triangles;
  sizes.triangle_bytes += payload.bytes.size();
  const int position = gltf.add_accessor(positions(payload.vertices, payload.bounds, lattice));
  const int indices = gltf.add_accessor(
      {{"componentType", kUnsignedInt}, {"type", "SCALAR"}, {"count", payload.triangles * 3}});
  const int view = gltf.add_view(payload.bytes.data(), payload.bytes.size(), GltfWriter::kNoTarget);
  return {{"mode", kTriangles},
          {"material", 0},
          {"attributes", {{"POSITION", position}}},
          {"indices", indices},
          {"extensions",
           {{kDracoExtension,
             {{"bufferView", view}, {"attributes", {{"POSITION", kDracoPositionId}}}}}}}};
}

json lines_primitive(GltfWriter& gltf, const Pslg& pslg, const Lattice& lattice,
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
    xyz.push_back(static_cast<float>(lattice.to_mm(p.x)));
    xyz.push_back(static_cast<float>(lattice.to_mm(p.y)));
    xyz.push_back(0.0F);
  }
  const auto add = [&](json accessor, const auto& data, int target) {
    const std::size_t bytes = data.size() * sizeof data[0];
    sizes.outline_bytes += bytes;
    accessor["bufferView"] = gltf.add_view(data.data(), bytes, target);
    return gltf.add_accessor(accessor);
  };
  json primitive = {{"mode", kLines}, {"material", 1}};
  primitive["attributes"]["POSITION"] =
      add(positions(points.size(), box_of(points), lattice), xyz, GltfWriter::kVertices);
  json accessor = {{"type", "SCALAR"}, {"count", indices.size()}};
  if (points.size() < 65535) {
    accessor["componentType"] = kUnsignedShort;
    primitive["indices"] = add(accessor, std::vector<std::uint16_t>(indices.begin(), indices.end()),
                               GltfWriter::kIndices);
  } else {
    accessor["componentType"] = kUnsignedInt;
    primitive["indices"] = add(accessor, indices, GltfWriter::kIndices);
  }
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

}  // namespace

Result<std::vector<std::uint8_t>> encode_asset(Asset asset, const ForEach& for_each,
                                               AssetSizes* sizes) {
  const auto grid = common_grid(asset);
  if (!grid) return grid.error();
  std::vector<Result<Payload>> payloads(asset.slices.size(), Payload{});
  const auto compress_one = [&](std::size_t i) {
    payloads[i] = compress(asset.slices[i], *grid);
    asset.slices[i].mesh = {};
  };
  if (for_each) {
    for_each(payloads.size(), compress_one);
  } else {
    for (std::size_t i = 0; i < payloads.size(); ++i)
      compress_one(i);
  }

  GltfWriter gltf;
  AssetSizes counted;
  std::size_t bytes = 4096;
  for (std::size_t i = 0; i < payloads.size(); ++i) {
    if (!payloads[i]) return payloads[i].error();
    bytes += payloads[i]->bytes.size() + 2048;  // the latter for its JSON
    for (const Ring& ring : asset.slices[i].pslg.rings)
      bytes += ring.size() * (3 * sizeof(float) + 2 * sizeof(std::uint32_t)) + 6;
  }
  gltf.reserve(bytes);
  gltf.add_node(root_node(asset.slices.size()));
  int meshes = 0;
  for (std::size_t i = 0; i < asset.slices.size(); ++i) {
    const Payload payload = std::move(*payloads[i]);
    const AssetSlice slice = std::move(asset.slices[i]);
    const std::string name = "slice " + std::to_string(slice.index);
    json node = {
        {"name", name},
        {"matrix", node_matrix(slice.T_lps_plane)},
        {"extras",
         {{"trocar",
           {{"index", slice.index}, {"z_mm", slice.z_mm}, {"measures", slice.measures}}}}}};
    if (payload.triangles > 0) {
      json primitives = json::array();
      primitives.push_back(triangles_primitive(gltf, payload, asset.lattice, counted));
      primitives.push_back(lines_primitive(gltf, slice.pslg, asset.lattice, counted));
      gltf.add_mesh({{"name", name}, {"primitives", std::move(primitives)}});
      node["mesh"] = meshes++;
    }
    gltf.add_node(node);
  }
  const std::size_t slices = asset.slices.size();
  asset.slices = {};
  payloads = {};
  auto file =
      std::move(gltf).finish({{"asset", {{"version", "2.0"}, {"generator", asset.generator}}},
                              {"extensionsUsed", {kDracoExtension, kUnlitExtension}},
                              {"extensionsRequired", json::array({kDracoExtension})},
                              {"materials", materials()},
                              {"scene", 0},
                              {"scenes", json::array({{{"nodes", json::array({0})}}})},
                              {"extras",
                               {{"trocar",
                                 {{"schema", kAssetSchema},
                                  {"lattice_bits", asset.lattice.bits},
                                  {"slices", slices},
                                  {"parameters", asset.parameters},
                                  {"input_digest", asset.input_digest}}}}}});
  if (!file) return file.error();
  counted.json_bytes = file->json_bytes;
  if (sizes != nullptr) *sizes = counted;
  return std::move(file->bytes);
}

}  // namespace trocar
