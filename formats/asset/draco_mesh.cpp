// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/draco_mesh.h"

#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>

#include <algorithm>
#include <cmath>
#include <string_view>

namespace trocar {
namespace {

// Draco allocates 24 bytes for each triangle that a payload states before it reads on. These limits
// bound what a few hostile bytes can cost. Refined meshes have 0.2 to 0.4 triangles a byte; a
// perfect grid can have a hundred, a large one more.
constexpr std::uint64_t kMaxTrianglesPerByte = 64, kAlwaysAllowedTriangles = 1 << 22;

}  // namespace

// The bytes before Edgebreaker's symbols (bitstream 2.2): name, version, mesh, method, flags, kind
// of traversal, vertices and faces. Draco allocates for these two numbers without a check.
Result<void> check_draco_counts(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles) {
  constexpr std::string_view kStart("DRACO\2\2\1\1\0\0", 11);
  if (bytes.size() < kStart.size() + 1 ||
      !std::equal(kStart.begin(), kStart.end(), bytes.begin(),
                  [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; })) {
    return refused("Draco: not an Edgebreaker mesh of bitstream 2.2");
  }
  std::size_t at = kStart.size() + 1;
  const auto varint = [&bytes, &at] {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 35 && at < bytes.size(); shift += 7) {
      const std::uint8_t byte = bytes[at++];
      value |= std::uint64_t{byte & 0x7fU} << shift;
      if (byte < 0x80) break;
    }
    return value;
  };
  const std::uint64_t vertices = varint(), triangles = varint();
  if (vertices > max_vertices || triangles > max_triangles)
    return refused("Draco: more vertices or triangles than stated");
  if (triangles > std::max(kAlwaysAllowedTriangles, kMaxTrianglesPerByte * bytes.size()))
    return refused("Draco: more triangles than its bytes can hold");
  return {};
}

Result<std::vector<std::uint8_t>> encode_draco(const SliceMesh& mesh, const DracoGrid& grid) {
  if (mesh.triangles.empty()) return bug("Draco: empty mesh");
  if (grid.quantization_bits < 1 || grid.quantization_bits > 24) {
    return bug("Draco: " + std::to_string(grid.quantization_bits) + " quantisation bits");
  }
  const std::int64_t max_q = (std::int64_t{1} << grid.quantization_bits) - 1;
  const auto step = static_cast<float>(grid.lattice.step_mm());

  draco::Mesh out;
  out.set_num_points(static_cast<std::uint32_t>(mesh.vertices.size()));
  draco::GeometryAttribute position;
  position.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_FLOAT32, false,
                3 * sizeof(float), 0);
  const int id = out.AddAttribute(position, true, static_cast<std::uint32_t>(mesh.vertices.size()));
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    const LatticePoint p = mesh.vertices[v];
    const std::int64_t qx = std::int64_t{p.x} - grid.origin.x,
                       qy = std::int64_t{p.y} - grid.origin.y;
    if (qx < 0 || qy < 0 || qx > max_q || qy > max_q) return bug("Draco: vertex outside the grid");
    const float xyz[3] = {static_cast<float>(p.x) * step, static_cast<float>(p.y) * step, 0.0F};
    out.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(v), xyz);
  }
  out.SetNumFaces(mesh.triangles.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& v = mesh.triangles[t];
    out.SetFace(draco::FaceIndex(t),
                {draco::PointIndex(v[0]), draco::PointIndex(v[1]), draco::PointIndex(v[2])});
  }

  draco::ExpertEncoder encoder(out);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  // In the plane one parallelogram predicts better than Draco's slowest choice, the constrained
  // average of several, whose flags cost more bits than they save. It also takes half the time.
  encoder.SetSpeedOptions(2, 2);
  if (const auto status =
          encoder.SetAttributePredictionScheme(id, draco::MESH_PREDICTION_PARALLELOGRAM);
      !status.ok()) {
    return bug("Draco: " + status.error_msg_string());
  }
  const float origin[3] = {static_cast<float>(grid.origin.x) * step,
                           static_cast<float>(grid.origin.y) * step, 0.0F};
  encoder.SetAttributeExplicitQuantization(id, grid.quantization_bits, 3, origin,
                                           static_cast<float>(max_q) * step);
  draco::EncoderBuffer buffer;
  if (const draco::Status status = encoder.EncodeToBuffer(&buffer); !status.ok()) {
    return bug("Draco: " + status.error_msg_string());
  }
  return std::vector<std::uint8_t>(buffer.data(), buffer.data() + buffer.size());
}

Result<SliceMesh> decode_draco(std::span<const std::uint8_t> bytes, const Lattice& lattice,
                               std::uint64_t max_vertices, std::uint64_t max_triangles) {
  if (auto ok = check_draco_counts(bytes, max_vertices, max_triangles); !ok) return ok.error();
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) return refused("Draco: " + decoded.status().error_msg_string());
  const std::unique_ptr<draco::Mesh> in = std::move(decoded).value();
  const draco::PointAttribute* position = in->GetNamedAttribute(draco::GeometryAttribute::POSITION);
  if (position == nullptr || position->data_type() != draco::DT_FLOAT32 ||
      position->num_components() != 3) {
    return refused("Draco: no float position");
  }
  if (in->num_points() > max_vertices || in->num_faces() > max_triangles) {
    return refused("Draco: more vertices or triangles than stated");
  }
  SliceMesh mesh;
  mesh.vertices.reserve(in->num_points());
  for (std::uint32_t v = 0; v < in->num_points(); ++v) {
    float xyz[3];
    const draco::AttributeValueIndex at = position->mapped_index(draco::PointIndex(v));
    if (at.value() >= position->size()) return refused("Draco: attribute index out of range");
    position->GetValue(at, xyz);
    const double x = std::ldexp(static_cast<double>(xyz[0]), lattice.bits);
    const double y = std::ldexp(static_cast<double>(xyz[1]), lattice.bits);
    if (!(std::abs(x) <= kMaxCoordinate && std::abs(y) <= kMaxCoordinate) || x != std::rint(x) ||
        y != std::rint(y) || xyz[2] != 0.0F) {
      return refused("Draco: vertex " + std::to_string(v) + " is off the lattice");
    }
    mesh.vertices.push_back({static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)});
  }
  mesh.triangles.reserve(in->num_faces());
  for (std::uint32_t t = 0; t < in->num_faces(); ++t) {
    const draco::Mesh::Face& face = in->face(draco::FaceIndex(t));
    Triangle triangle{};
    for (std::size_t i = 0; i < 3; ++i) {
      triangle[i] = face[i].value();
      if (triangle[i] >= mesh.vertices.size()) return refused("Draco: index out of range");
    }
    mesh.triangles.push_back(triangle);
  }
  return mesh;
}

}  // namespace trocar
