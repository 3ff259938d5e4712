// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/surface_payload.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "formats/asset/draco_settings.h"

namespace trocar {
namespace {

constexpr int kNormalBits = 8;

}  // namespace

Result<std::vector<std::uint8_t>> encode_surface(const TriangleSurface& surface) {
  if (auto ok = check_triangle_surface(surface); !ok) return bug(ok.error().message);
  const auto vertices = static_cast<std::uint32_t>(surface.vertices.size());
  std::array<float, 3> low{};
  std::int64_t extent = 1;
  const auto [lowest, highest] = box_around(surface.vertices);
  for (std::size_t k = 0; k < 3; ++k) {
    low[k] = static_cast<float>(lowest[k]);
    extent = std::max(extent, std::int64_t{highest[k]} - lowest[k]);
  }
  int bits = 1;
  while ((std::int64_t{1} << bits) - 1 < extent)
    ++bits;
  // Draco's float arithmetic is exact as long as all numbers fit a float's 24 bits.
  if (bits > 24) return refused("the surface has more lattice steps than an asset holds");

  draco::Mesh mesh;
  mesh.set_num_points(vertices);
  const int position =
      add_attribute(mesh, draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int normal = add_attribute(mesh, draco::GeometryAttribute::NORMAL, 3, draco::DT_FLOAT32);
  const std::vector<Eigen::Vector3f> normals = vertex_normals(surface);
  for (std::uint32_t v = 0; v < vertices; ++v) {
    const SpacePoint& p = surface.vertices[v];
    const std::array<float, 3> xyz{static_cast<float>(p[0]), static_cast<float>(p[1]),
                                   static_cast<float>(p[2])};
    mesh.attribute(position)->SetAttributeValue(draco::AttributeValueIndex(v), xyz.data());
    mesh.attribute(normal)->SetAttributeValue(draco::AttributeValueIndex(v), normals[v].data());
  }
  set_triangles(mesh, surface.triangles);
  draco::ExpertEncoder encoder(mesh);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(2, 2);
  encoder.SetAttributeExplicitQuantization(position, bits, 3, low.data(),
                                           static_cast<float>((std::int64_t{1} << bits) - 1));
  encoder.SetAttributeQuantization(normal, kNormalBits);
  draco::EncoderBuffer buffer;
  if (const draco::Status status = encoder.EncodeToBuffer(&buffer); !status.ok())
    return bug("Draco: " + status.error_msg_string());
  return std::vector<std::uint8_t>(buffer.data(), buffer.data() + buffer.size());
}

Result<TriangleSurface> decode_surface(std::span<const std::uint8_t> bytes, std::uint64_t vertices,
                                       std::uint64_t triangles, const Lattice& lattice) {
  const auto decoded = decode_payload(bytes, vertices, triangles);
  if (!decoded) return decoded.error();
  const draco::Mesh* const in = decoded->get();
  const draco::PointAttribute* position = in->GetAttributeByUniqueId(kDracoSurfacePositionId);
  const draco::PointAttribute* normal = in->GetAttributeByUniqueId(kDracoSurfaceNormalId);
  if (in->num_attributes() != 2 || position == nullptr || normal == nullptr ||
      position->attribute_type() != draco::GeometryAttribute::POSITION ||
      normal->attribute_type() != draco::GeometryAttribute::NORMAL ||
      position->data_type() != draco::DT_FLOAT32 || position->num_components() != 3) {
    return refused("Draco: not the positions and normals of a surface");
  }
  if (in->num_points() != vertices || in->num_faces() != triangles)
    return refused("Draco: other numbers of vertices or triangles than stated");
  TriangleSurface out;
  out.lattice = lattice;
  out.vertices.reserve(in->num_points());
  for (std::uint32_t v = 0; v < in->num_points(); ++v) {
    std::array<float, 3> xyz{};
    const draco::AttributeValueIndex at = position->mapped_index(draco::PointIndex(v));
    if (at.value() >= position->size()) return refused("Draco: attribute index out of range");
    position->GetValue(at, xyz.data());
    SpacePoint p{};
    for (std::size_t k = 0; k < 3; ++k) {
      if (!(std::abs(xyz[k]) <= static_cast<float>(kMaxSpaceCoordinate)) ||
          xyz[k] != std::rint(xyz[k]))
        return refused("Draco: vertex " + std::to_string(v) + " is off the lattice");
      p[k] = static_cast<std::int32_t>(xyz[k]);
    }
    out.vertices.push_back(p);
  }
  out.triangles.reserve(in->num_faces());
  for (std::uint32_t t = 0; t < in->num_faces(); ++t) {
    const draco::Mesh::Face& face = in->face(draco::FaceIndex(t));
    for (std::size_t i = 0; i < 3; ++i)
      if (face[i].value() >= out.vertices.size()) return refused("Draco: index out of range");
    out.triangles.push_back({face[0].value(), face[1].value(), face[2].value()});
  }
  return out;
}

std::array<double, 16> surface_matrix(const Lattice& lattice) {
  const double step = lattice.step_m();
  return {step, 0, 0, 0, 0, 0, -step, 0, 0, step, 0, 0, 0, 0, 0, 1};
}

}  // namespace trocar
