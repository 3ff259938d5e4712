// SPDX-License-Identifier: Apache-2.0
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/draco_mesh.h"
#include "formats/asset/gltf_document.h"
#include "formats/asset/hu_section.h"
#include "formats/asset/slice_payload.h"
#include "formats/base/file_io.h"

namespace trocar {

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

}  // namespace trocar
