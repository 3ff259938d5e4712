// SPDX-License-Identifier: Apache-2.0
// The settings of Draco's encoder, how its input is made, and how a payload is decoded. This is the
// only header of the folder that includes Draco. Internal to formats/.
#pragma once

#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "formats/asset/draco_mesh.h"

namespace trocar {

/// Adds an attribute with one value for each point of the mesh, and returns its id. The values are
/// not yet set.
inline int add_attribute(draco::Mesh& mesh, draco::GeometryAttribute::Type type,
                         std::uint8_t components, draco::DataType data, bool normalized = false) {
  draco::GeometryAttribute attribute;
  attribute.Init(type, nullptr, components, data, normalized,
                 components * draco::DataTypeLength(data), 0);
  return mesh.AddAttribute(attribute, true, mesh.num_points());
}

/// Sets the triangles of a mesh that has all its points.
inline void set_triangles(draco::Mesh& mesh, const std::vector<Triangle>& triangles) {
  mesh.SetNumFaces(triangles.size());
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    const Triangle& v = triangles[t];
    mesh.SetFace(draco::FaceIndex(t),
                 {draco::PointIndex(v[0]), draco::PointIndex(v[1]), draco::PointIndex(v[2])});
  }
}

/// Sets the encoder's options. Preconditions: `mesh` is the encoder's input, and its attribute 0 is
/// the position.
inline draco::Status configure(draco::ExpertEncoder& encoder, const draco::PointCloud& mesh,
                               const DracoGrid& grid) {
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  // Prediction by one parallelogram compresses points in a plane better than Draco's slowest
  // setting, which predicts by a constrained average of several parallelograms. That setting
  // stores flags, which cost more bits than they save. One parallelogram also takes half the time.
  encoder.SetSpeedOptions(2, 2);
  // Each vertex has one HU and one colour. So there are no seams, which are edges whose vertices
  // have two values. With this setting, decoding takes a quarter less time.
  encoder.options().SetGlobalBool("split_mesh_on_seams", true);
  const float origin[3] = {static_cast<float>(grid.origin.x), static_cast<float>(grid.origin.y),
                           0.0F};
  const std::int64_t range = (std::int64_t{1} << grid.quantization_bits) - 1;
  encoder.SetAttributeExplicitQuantization(0, grid.quantization_bits, 3, origin,
                                           static_cast<float>(range));
  draco::Status status =
      encoder.SetAttributePredictionScheme(0, draco::MESH_PREDICTION_PARALLELOGRAM);
  for (int id = 1; status.ok() && id < mesh.num_attributes(); ++id)
    status = encoder.SetAttributePredictionScheme(id, draco::PREDICTION_DIFFERENCE);
  return status;
}

/// Decodes a payload. Errors: kRefused if check_draco_counts() refuses it, if the bytes are
/// corrupted, or if bytes are left after the mesh.
inline Result<std::unique_ptr<draco::Mesh>> decode_payload(std::span<const std::uint8_t> bytes,
                                                           std::uint64_t max_vertices,
                                                           std::uint64_t max_triangles) {
  if (auto ok = check_draco_counts(bytes, max_vertices, max_triangles); !ok) return ok.error();
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) return refused("Draco: " + decoded.status().error_msg_string());
  if (buffer.remaining_size() != 0) return refused("Draco: bytes after the mesh");
  return std::move(decoded).value();
}

}  // namespace trocar
