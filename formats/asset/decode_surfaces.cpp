// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/decode_surfaces.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "formats/asset/surface_payload.h"

namespace trocar {
namespace {

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
  if (node.mesh < 0 || static_cast<std::size_t>(node.mesh) >= model.meshes.size())
    return refused("mesh index out of range");
  const auto& primitives = model.meshes[static_cast<std::size_t>(node.mesh)].primitives;
  if (primitives.size() != 1 || primitives[0].mode != TINYGLTF_MODE_TRIANGLES)
    return refused("expected one primitive of triangles");
  return draco_primitive(model, primitives[0]);
}

Result<TriangleSurface> decode_geometry(const DracoPrimitive& draco, const Lattice& lattice) {
  auto decoded = decode_surface(draco.payload, draco.vertices, draco.triangles, lattice);
  if (!decoded) return decoded.error();
  const std::vector<double>&stated_low = draco.position->minValues,
        &stated_high = draco.position->maxValues;
  for (std::size_t k = 0; k < 3; ++k) {
    double low = kMaxSpaceCoordinate, high = -kMaxSpaceCoordinate;
    for (const SpacePoint& p : decoded->vertices) {
      low = std::min(low, static_cast<double>(p[k]));
      high = std::max(high, static_cast<double>(p[k]));
    }
    if (stated_low.size() != 3 || stated_high.size() != 3 || stated_low[k] != low ||
        stated_high[k] != high)
      return refused("accessor bounds differ from the vertices");
  }
  return decoded;
}

}  // namespace

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
    auto geometry = decode_geometry(*draco, surface->surface.lattice);
    if (!geometry) return geometry.error();
    surface->surface = std::move(*geometry);
    asset.surfaces.push_back(std::move(*surface));
  }
  return {};
}

}  // namespace trocar
