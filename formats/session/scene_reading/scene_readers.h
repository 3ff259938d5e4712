// SPDX-License-Identifier: Apache-2.0
// Readers of the scene's sections. Each reads from the object or array of its section, and reports
// errors there. Internal to formats/session.
// Tests: tests/formats/session/scene_test.cpp
#pragma once
#include <span>
#include <string>

#include "formats/base/strict_json.h"
#include "formats/session/scene.h"

namespace trocar {

inline constexpr double kMaxPosition_m = 1.0;  ///< largest |coordinate| in the device's frame

/// Reads the fields of a tissue that a scene's `tissue` and each of its `tissues` have.
void read_tissue(StrictObject& object, Tissue& tissue);
void read_tissues(StrictObject& scene, std::vector<NamedTissue>& tissues);
void read_layers(StrictObject& scene, std::vector<SceneLayer>& layers);
void read_force_law(StrictObject& object, SceneForceLaw& law);
void read_goals(StrictObject& object, SceneGoals& goals);

/// Reads the corners of a simple polygon, whose |coordinates| are at most `max_m`.
std::vector<std::array<double, 2>> read_polygon(StrictObject& object, const char* key,
                                                std::size_t max_corners, double max_m);
/// Is the polygon clockwise?
bool is_clockwise(std::span<const std::array<double, 2>> polygon_m);

/// Adds an error if an element before the last one has the last one's name.
template <typename Named>
void check_last_name(const std::vector<Named>& list, StrictObject& object) {
  for (std::size_t i = 0; i + 1 < list.size(); ++i) {
    if (list[i].name == list.back().name) object.error("name", "occurs twice");
  }
}

}  // namespace trocar
