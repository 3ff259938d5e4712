// SPDX-License-Identifier: GPL-3.0-or-later
// How slices lie above each other: their distances, and the shift from one to the next.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

struct StackShape {
  std::vector<double> gaps_mm;  ///< along the normal, from each slice to the next
  double step_mm = 0;           ///< their median; 0 for a single slice
  double shift_mm = 0;          ///< the largest within the planes
  double tilt_deg = 0;          ///< of a gantry: between the normal and the line of the positions

  bool is_tilted() const { return shift_mm > 0.01; }
  bool is_uneven(std::size_t gap) const;  ///< by more than 1 % of the median
  std::optional<std::size_t> first_uneven() const;
};

/// Of slices in order along the unit normal: their origins, mm.
StackShape stack_shape(const std::vector<Eigen::Vector3d>& positions,
                       const Eigen::Vector3d& normal);

StackShape stack_shape(const SliceStack& stack);

}  // namespace trocar::pipeline
