// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <sstream>
#include <utility>

#include "formats/asset.h"
#include "formats/draco_mesh.h"
#include "formats/gltf.h"
#include "formats/mesh_validity.h"

namespace trocar {
namespace {

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

class Buffer {
 public:
  // Appends bytes as a buffer view, 4-byte aligned; gives the view's index.
  int add(tinygltf::Model& model, const void* data, std::size_t size, int target) {
    bytes_.resize((bytes_.size() + 3) & ~std::size_t{3});
    tinygltf::BufferView view;
    view.buffer = 0;
    view.byteOffset = bytes_.size();
    view.byteLength = size;
    view.target = target;
    const auto* begin = static_cast<const unsigned char*>(data);
    bytes_.insert(bytes_.end(), begin, begin + size);
    model.bufferViews.push_back(std::move(view));
    return static_cast<int>(model.bufferViews.size()) - 1;
  }
  std::vector<unsigned char> take() { return std::move(bytes_); }

 private:
  std::vector<unsigned char> bytes_;
};

int add_accessor(tinygltf::Model& model, int view, int component_type, int type,
                 std::size_t count) {
  tinygltf::Accessor accessor;
  accessor.bufferView = view;
  accessor.componentType = component_type;
  accessor.type = type;
  accessor.count = count;
  model.accessors.push_back(std::move(accessor));
  return static_cast<int>(model.accessors.size()) - 1;
}

// glTF wants the bounds of the float32 values; lattice multiples are exact in it.
void set_bounds(tinygltf::Accessor& accessor, const std::vector<LatticePoint>& points,
                const Lattice& lattice) {
  LatticePoint low = points.front(), high = low;
  for (LatticePoint p : points) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y)};
  }
  accessor.minValues = {lattice.to_mm(low.x), lattice.to_mm(low.y), 0.0};
  accessor.maxValues = {lattice.to_mm(high.x), lattice.to_mm(high.y), 0.0};
}

// A slice's triangles as they will be in the file, with what glTF says about them.
struct Payload {
  std::vector<std::uint8_t> bytes;
  std::vector<LatticePoint> vertices;
  std::size_t triangles = 0;
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
  out.vertices = std::move(decoded->vertices);
  out.triangles = decoded->triangles.size();
  return out;
}

tinygltf::Primitive triangles_primitive(tinygltf::Model& model, Buffer& buffer,
                                        const Payload& payload, const Lattice& lattice) {
  tinygltf::Primitive primitive;
  primitive.mode = TINYGLTF_MODE_TRIANGLES;
  primitive.material = 0;
  const int position = add_accessor(model, -1, TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC3,
                                    payload.vertices.size());
  set_bounds(model.accessors[static_cast<std::size_t>(position)], payload.vertices, lattice);
  primitive.attributes["POSITION"] = position;
  primitive.indices = add_accessor(model, -1, TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT,
                                   TINYGLTF_TYPE_SCALAR, payload.triangles * 3);
  const int view = buffer.add(model, payload.bytes.data(), payload.bytes.size(), 0);
  primitive.extensions[kDracoExtension] = to_value(
      {{"bufferView", view}, {"attributes", {{"POSITION", static_cast<int>(kDracoPositionId)}}}});
  return primitive;
}

tinygltf::Primitive lines_primitive(tinygltf::Model& model, Buffer& buffer, const Pslg& pslg,
                                    const Lattice& lattice) {
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
  tinygltf::Primitive primitive;
  primitive.mode = TINYGLTF_MODE_LINE;
  primitive.material = 1;
  int view =
      buffer.add(model, xyz.data(), xyz.size() * sizeof(float), TINYGLTF_TARGET_ARRAY_BUFFER);
  const int position =
      add_accessor(model, view, TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC3, points.size());
  set_bounds(model.accessors[static_cast<std::size_t>(position)], points, lattice);
  primitive.attributes["POSITION"] = position;
  if (points.size() < 65535) {
    const std::vector<std::uint16_t> narrow(indices.begin(), indices.end());
    view = buffer.add(model, narrow.data(), narrow.size() * sizeof(std::uint16_t),
                      TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER);
    primitive.indices = add_accessor(model, view, TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT,
                                     TINYGLTF_TYPE_SCALAR, indices.size());
  } else {
    view = buffer.add(model, indices.data(), indices.size() * sizeof(std::uint32_t),
                      TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER);
    primitive.indices = add_accessor(model, view, TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT,
                                     TINYGLTF_TYPE_SCALAR, indices.size());
  }
  return primitive;
}

void add_materials(tinygltf::Model& model) {
  tinygltf::Material bone;
  bone.name = "material";
  bone.doubleSided = true;
  bone.pbrMetallicRoughness.baseColorFactor = {0.89, 0.85, 0.76, 1.0};
  bone.pbrMetallicRoughness.metallicFactor = 0.0;
  bone.pbrMetallicRoughness.roughnessFactor = 0.9;
  tinygltf::Material outline;
  outline.name = "outline";
  outline.pbrMetallicRoughness.baseColorFactor = {0.55, 0.1, 0.1, 1.0};
  outline.extensions[kUnlitExtension] = tinygltf::Value(tinygltf::Value::Object{});
  model.materials = {bone, outline};
}

std::vector<double> node_matrix(const Eigen::Affine3d& T) {
  const Eigen::Matrix4d& m = T.matrix();
  return {m.data(), m.data() + 16};  // Eigen and glTF are both column-major
}

}  // namespace

Result<std::vector<std::uint8_t>> encode_asset(const Asset& asset, const ForEach& for_each) {
  const auto grid = common_grid(asset);
  if (!grid) return grid.error();
  std::vector<Result<Payload>> payloads(asset.slices.size(), Payload{});
  const auto compress_one = [&](std::size_t i) { payloads[i] = compress(asset.slices[i], *grid); };
  if (for_each) {
    for_each(payloads.size(), compress_one);
  } else {
    for (std::size_t i = 0; i < payloads.size(); ++i)
      compress_one(i);
  }

  tinygltf::Model model;
  model.asset.version = "2.0";
  model.asset.generator = asset.generator;
  model.extensionsUsed = {kDracoExtension, kUnlitExtension};
  model.extensionsRequired = {kDracoExtension};
  model.extras = to_value({{"trocar",
                            {{"schema", kAssetSchema},
                             {"lattice_bits", asset.lattice.bits},
                             {"slices", asset.slices.size()},
                             {"parameters", asset.parameters},
                             {"input_digest", asset.input_digest}}}});
  add_materials(model);

  tinygltf::Node root;
  root.name = "scan";
  // LPS mm -> glTF metres, +Y up: (x, y, z) -> (x, z, -y) / 1000.
  root.matrix = {1e-3, 0, 0, 0, 0, 0, -1e-3, 0, 0, 1e-3, 0, 0, 0, 0, 0, 1};
  model.nodes.push_back(root);

  Buffer buffer;
  for (std::size_t i = 0; i < asset.slices.size(); ++i) {
    const AssetSlice& slice = asset.slices[i];
    if (!payloads[i]) return payloads[i].error();
    tinygltf::Node node;
    node.name = "slice " + std::to_string(slice.index);
    node.matrix = node_matrix(slice.T_lps_plane);
    node.extras = to_value(
        {{"trocar", {{"index", slice.index}, {"z_mm", slice.z_mm}, {"measures", slice.measures}}}});
    if (!slice.mesh.triangles.empty()) {
      tinygltf::Mesh mesh;
      mesh.name = node.name;
      mesh.primitives = {triangles_primitive(model, buffer, *payloads[i], asset.lattice),
                         lines_primitive(model, buffer, slice.pslg, asset.lattice)};
      model.meshes.push_back(std::move(mesh));
      node.mesh = static_cast<int>(model.meshes.size()) - 1;
    }
    model.nodes.push_back(std::move(node));
    model.nodes[0].children.push_back(static_cast<int>(model.nodes.size()) - 1);
  }
  tinygltf::Scene scene;
  scene.nodes = {0};
  model.scenes.push_back(std::move(scene));
  model.defaultScene = 0;
  std::vector<unsigned char> bytes = buffer.take();
  bytes.resize((bytes.size() + 3) & ~std::size_t{3});
  if (!bytes.empty()) {
    tinygltf::Buffer out;
    out.data = std::move(bytes);
    model.buffers.push_back(std::move(out));
  }

  std::ostringstream stream;
  tinygltf::TinyGLTF gltf;
  if (!gltf.WriteGltfSceneToStream(&model, stream, false, true))
    return bug("tinygltf could not serialise");
  const std::string text = std::move(stream).str();
  return std::vector<std::uint8_t>(text.begin(), text.end());
}

}  // namespace trocar
