// SPDX-License-Identifier: Apache-2.0
// How Draco encodes a payload. Private: the only header here that includes Draco.
#pragma once

#include <draco/compression/expert_encode.h>

#include <cstdint>

#include "formats/asset/draco_mesh.h"

namespace trocar {

/// `mesh` is what the encoder encodes; its attribute 0 is the position.
inline draco::Status configure(draco::ExpertEncoder& encoder, const draco::PointCloud& mesh,
                               const DracoGrid& grid) {
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  // In the plane one parallelogram predicts better than Draco's slowest choice, the constrained
  // average of several, whose flags cost more bits than they save. It also takes half the time.
  encoder.SetSpeedOptions(2, 2);
  // HU and colours have the connectivity of the positions: no seams of their own. Decoding takes a
  // quarter less time.
  encoder.options().SetGlobalBool("split_mesh_on_seams", true);
  const float origin[3] = {static_cast<float>(grid.origin.x), static_cast<float>(grid.origin.y),
                           0.0F};
  const std::int64_t most = (std::int64_t{1} << grid.quantization_bits) - 1;
  encoder.SetAttributeExplicitQuantization(0, grid.quantization_bits, 3, origin,
                                           static_cast<float>(most));
  draco::Status status =
      encoder.SetAttributePredictionScheme(0, draco::MESH_PREDICTION_PARALLELOGRAM);
  for (int id = 1; status.ok() && id < mesh.num_attributes(); ++id)
    status = encoder.SetAttributePredictionScheme(id, draco::PREDICTION_DIFFERENCE);
  return status;
}

}  // namespace trocar
