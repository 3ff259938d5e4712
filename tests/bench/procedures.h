// SPDX-License-Identifier: Apache-2.0
// Named procedures: the force that the cutting law predicts beside what has been published, with
// the conditions of both. Two constants of bone are fitted, each on one row that says so; whatever
// else differs is a miss and is printed as one.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "runtime/bone_cutting/law/soft_layer.h"
#include "runtime/bone_cutting/material/tool_in_tissue.h"

namespace trocar::test {

/// Bone values that the authors' publications do not give.
struct BoneConstants {
  double pressure_over_yield = 1;  ///< on the tip and on the shaft, over the yield strength
  double friction = 0.2;           ///< coefficient of the tool on bone
};

enum class Standing {
  kFitted,     ///< a constant is fitted on this row
  kPredicted,  ///< nothing of this row was used
  kGiven,      ///< the published force is the law's input; what is shown is what it renders
};

struct Procedure {
  std::string name;
  Standing standing = Standing::kPredicted;
  std::string tool, tissue;  ///< values that the law uses, and which of them are assumed
  runtime::ToolShape shape;
  double density_g_per_cm3 = 0;  ///< QCT, of the bone; 0: no bone
  double strength_Pa = 0;        ///< strength of a tissue other than bone
  double rubbing_m = 0;   ///< length of the rubbing shaft at the depth of the published force
  double slice_push = 0;  ///< twist
  bool is_share_of_work = false;  ///< not a force: friction's share of the work of the insertion
  std::vector<runtime::SoftLayer>
      layers;  ///< layers of a procedure in soft tissue, instead of bone
  double published_low = 0, published_high = 0;  ///< N, or the share
  std::string conditions, source;
};

std::vector<Procedure> procedures();

/// Solves the fitted rows, of which there must be two: one with a shaft that rubs, one without.
/// Throws std::invalid_argument.
BoneConstants fit(std::span<const Procedure> rows);

/// N, or the share: from a push through the law.
double predict(const Procedure& procedure, const BoneConstants& constants);

/// Within the published range; within 20 % of it where it is one value.
bool is_hit(const Procedure& procedure, double predicted);

}  // namespace trocar::test
