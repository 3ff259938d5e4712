// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/stated_entries.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "formats/asset/draco_mesh.h"
#include "formats/asset/slice_payload.h"

namespace trocar {
namespace {

// The box of vertices at one height, from the bounds of positions.
struct Box {
  LatticePoint low, high;
  std::int32_t z = 0;
};
Result<Box> box_of(const tinygltf::Accessor& position) {
  const std::vector<double>&low = position.minValues, &high = position.maxValues;
  if (low.size() != 3 || high.size() != 3 || low[2] != high[2])
    return refused("accessor without bounds in the plane");
  std::array<std::int32_t, 5> steps{};
  const std::array bounds{low[0], low[1], high[0], high[1], low[2]};
  for (std::size_t i = 0; i < bounds.size(); ++i) {
    const double c = bounds[i];
    if (!(std::abs(c) <= kMaxCoordinate) || c != std::rint(c))
      return refused("accessor bounds are off the lattice");
    steps[i] = static_cast<std::int32_t>(c);
  }
  return Box{{steps[0], steps[1]}, {steps[2], steps[3]}, steps[4]};
}

// Does the accessor have one element of this type for each vertex, under this Draco id?
bool is_per_vertex(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                   const char* attribute, int component, int type, std::uint32_t id,
                   std::size_t vertices) {
  const tinygltf::Accessor* accessor = attribute_of(model, primitive, attribute);
  return accessor != nullptr && accessor->componentType == component && accessor->type == type &&
         accessor->count == vertices && draco_id(primitive, attribute) == static_cast<int>(id);
}

// Sets which attributes beside the position the payload has.
Result<void> state_attributes(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                              StatedEntry& stated) {
  const std::size_t vertices = stated.vertices;
  if (draco_id(primitive, "POSITION") != static_cast<int>(kDracoPositionId))
    return refused("its position has another Draco id");
  stated.has_hu = primitive.attributes.contains(kHuAttribute);
  if (!stated.has_hu) return {};
  if (!is_per_vertex(model, primitive, kHuAttribute, TINYGLTF_COMPONENT_TYPE_SHORT,
                     TINYGLTF_TYPE_SCALAR, kDracoHuId, vertices))
    return refused("HU that are not one for each vertex");
  stated.has_colours = primitive.attributes.contains(kColourAttribute);
  if (stated.has_colours &&
      !(is_per_vertex(model, primitive, kColourAttribute, TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE,
                      TINYGLTF_TYPE_VEC3, kDracoColourId, vertices) &&
        attribute_of(model, primitive, kColourAttribute)->normalized))
    return refused("colours that are not one for each vertex");
  return {};
}

Result<void> state_triangles(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                             const Asset& asset, StatedEntry& stated) {
  EntryRecord& record = stated.record;
  const auto draco = draco_primitive(model, primitive);
  if (!draco) return draco.error();
  record.draco_offset = draco->offset;
  record.draco_bytes = static_cast<std::uint32_t>(draco->payload.size());
  stated.vertices = draco->vertices;
  stated.triangles = draco->triangles;
  const auto box = box_of(*draco->position);
  if (!box) return box.error();
  stated.low = box->low;
  stated.high = box->high;
  stated.z = box->z;
  if (element_at(asset.materials, primitive.material) == nullptr)
    return refused("its material is not in the list");
  record.material = static_cast<std::uint16_t>(primitive.material);
  return state_attributes(model, primitive, stated);
}

Result<void> state_lines(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                         StatedEntry& stated) {
  const tinygltf::Accessor* position = attribute_of(model, primitive, "POSITION");
  const tinygltf::Accessor* index = element_at(model.accessors, primitive.indices);
  if (position == nullptr || index == nullptr ||
      position->componentType != TINYGLTF_COMPONENT_TYPE_FLOAT ||
      position->type != TINYGLTF_TYPE_VEC3 || index->type != TINYGLTF_TYPE_SCALAR) {
    return refused("outline without positions or indices");
  }
  const bool narrow = index->componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
  const bool wide = index->componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
  stated.segment_index_bytes = narrow ? 2 : 4;
  const auto points = packed_view(model, *position, 3 * sizeof(float));
  const auto segments = packed_view(model, *index, stated.segment_index_bytes);
  if (!points || !segments || !(narrow || wide) || index->count != 2 * position->count) {
    return refused("outline data outside the buffer or of the wrong size");
  }
  stated.outline_offset = offset_of(model, *points);
  stated.outline_vertices = static_cast<std::uint32_t>(position->count);
  stated.segments_offset = offset_of(model, *segments);
  return {};
}

}  // namespace

Result<std::vector<StatedEntry>> stated_entries(const tinygltf::Model& model,
                                                const tinygltf::Node& node, int first_index,
                                                const Asset& asset) {
  std::vector<StatedEntry> out(1);
  out[0].record.index = first_index;
  if (node.mesh < 0) return out;
  const auto at = [&out] { return "slice " + std::to_string(out.back().record.index) + ": "; };
  const tinygltf::Mesh* const mesh = element_at(model.meshes, node.mesh);
  if (mesh == nullptr) return refused(at() + "mesh index out of range");
  const std::vector<tinygltf::Primitive>& primitives = mesh->primitives;
  const auto has_mode = [&primitives](std::size_t i, int mode) {
    return i < primitives.size() && primitives[i].mode == mode;
  };
  if (primitives.empty()) return refused(at() + "expected one triangles and one lines primitive");
  for (std::size_t i = 0; i < primitives.size(); ++i) {
    if (i > 0) {
      if (out.size() == kMaxNodeEntries ||
          out.back().record.index == std::numeric_limits<int>::max())
        return refused(at() + "too many slices in its node");
      const int next = out.back().record.index + 1;
      out.emplace_back().record.index = next;
    }
    StatedEntry& stated = out.back();
    if (!has_mode(i, TINYGLTF_MODE_TRIANGLES))
      return refused(at() + "expected one triangles and one lines primitive");
    if (auto ok = state_triangles(model, primitives[i], asset, stated); !ok)
      return refused(at() + ok.error().message);
    stated.has_lines = has_mode(i + 1, TINYGLTF_MODE_LINE);
    if (!stated.has_lines) continue;
    if (auto ok = state_lines(model, primitives[++i], stated); !ok)
      return refused(at() + ok.error().message);
  }
  return out;
}

std::size_t count_entries(const tinygltf::Model& model, const std::vector<int>& nodes) {
  std::size_t count = 0;
  for (const int number : nodes) {
    const tinygltf::Node* const node = element_at(model.nodes, number);
    const auto* const mesh = node == nullptr ? nullptr : element_at(model.meshes, node->mesh);
    if (mesh == nullptr) {
      ++count;
      continue;
    }
    count += static_cast<std::size_t>(std::count_if(
        mesh->primitives.begin(), mesh->primitives.end(),
        [](const tinygltf::Primitive& p) { return p.mode == TINYGLTF_MODE_TRIANGLES; }));
  }
  return count;
}

}  // namespace trocar
