// SPDX-License-Identifier: Apache-2.0
#include <array>

#include "formats/session/scene_reading/scene_readers.h"

namespace trocar {
namespace {

void read_network(StrictObject& object, SceneForceLaw& law) {
  law.solver = static_cast<NetworkSolver>(
      object.choice("solver", std::array{"auto", "local", "global", "propagation"}));
  object.read("reach_m", law.decay_length_m, 5e-4, 0.2);
  if (law.solver == NetworkSolver::kAuto) object.read("error_bound", law.error_bound, 1e-4, 0.5);
  if (law.solver == NetworkSolver::kLocal) object.read("radius_m", law.radius_m, 1e-3, 0.5);
  if (law.solver == NetworkSolver::kPropagation)
    law.depth = static_cast<int>(object.integer("depth", 1, 64, law.depth));
}

void read_cutting(StrictObject& object, SceneForceLaw& law) {
  law.axis = static_cast<ToolAxis>(object.choice("axis", std::array{"auto", "rigid", "coupled"}));
  object.read("coupling_N_per_m", law.coupling_N_per_m, 100.0, 1e6);
  object.read("coupling_Nm_per_rad", law.coupling_Nm_per_rad, 0.1, 1e4);
  law.prediction =
      static_cast<PosePrediction>(object.choice("prediction", std::array{"auto", "on", "off"}));
  object.read("tip_friction", law.tip_friction, 0.0, 2.0);
  object.read("tip_hold", law.tip_hold, 0.0, 1.0);
  law.twist = object.boolean("twist");
}

}  // namespace

void read_force_law(StrictObject& object, SceneForceLaw& law) {
  if (const auto kind = force_law_from_string(object.string("kind"))) {
    law.kind = *kind;
  } else {
    object.error("kind", "must be " + force_law_names("\""));
  }
  object.read("force_scale", law.force_scale, 1e-3, 10.0);
  if (law.kind == ForceLawKind::kNetwork) read_network(object, law);
  if (law.kind == ForceLawKind::kCutting) read_cutting(object, law);
}

}  // namespace trocar
