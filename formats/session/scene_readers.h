// SPDX-License-Identifier: Apache-2.0
// Readers of the scene's sections. Each function reads the object or array of one section, and adds
// what is wrong to the errors of the document. Internal to formats/session.
#pragma once

#include <span>
#include <string>

#include "formats/base/json.h"
#include "formats/session/scene.h"

namespace trocar {

inline constexpr double kMaxPosition_m = 1.0;  ///< largest |coordinate| in the device's frame

/// Reads the fields of one tissue. The scene's `tissue` has these fields, and so has each element
/// of `tissues`.
void read_tissue(StrictObject& object, Tissue& tissue);
void read_tissues(StrictObject& scene, std::vector<NamedTissue>& tissues);
void read_layers(StrictObject& scene, std::vector<SceneLayer>& layers);
void read_force_law(StrictObject& object, SceneForceLaw& law);
void read_goals(StrictObject& object, SceneGoals& goals);

/// Reads the corners of a polygon. Adds an error if the polygon is not simple, has too many
/// corners, or has a |coordinate| above `max_m`.
std::vector<std::array<double, 2>> read_polygon(StrictObject& object, const char* key,
                                                std::size_t max_corners, double max_m);
/// Returns true if the polygon is clockwise.
bool is_clockwise(std::span<const std::array<double, 2>> polygon_m);

/// Adds an error if the last element has the same name as an earlier one.
template <typename Named>
void check_last_name(const std::vector<Named>& list, StrictObject& object) {
  for (std::size_t i = 0; i + 1 < list.size(); ++i) {
    if (list[i].name == list.back().name) object.error("name", "occurs twice");
  }
}

}  // namespace trocar
