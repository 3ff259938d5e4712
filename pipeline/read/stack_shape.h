// SPDX-License-Identifier: GPL-3.0-or-later
// The distances between slices, and the shift from one slice to the next.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

struct StackShape {
  std::vector<double> gaps_mm;  ///< distances along the normal, from each slice to the next
  double step_mm = 0;           ///< median of gaps_mm; 0 for a single slice
  double shift_mm = 0;  ///< largest in-plane shift of a slice's origin relative to the slice before
  /// Gantry tilt: the angle between the normal and the line from the first position to the last.
  double tilt_deg = 0;

  bool is_tilted() const { return shift_mm > 0.01; }
  bool is_uneven(std::size_t gap) const;  ///< true if the gap differs from step_mm by more than 1 %
  std::optional<std::size_t> first_uneven() const;
};

/// `positions` are the origins of the slices in mm, and `normal` is a unit vector. Precondition:
/// the positions ascend along the normal.
StackShape stack_shape(const std::vector<Eigen::Vector3d>& positions,
                       const Eigen::Vector3d& normal);

StackShape stack_shape(const SliceStack& stack);

/// Checks that each slice from `first` to `last` is parallel to slice `first`, has the same pixel
/// spacing, and lies above the slice before it. Errors: kRefused if a slice fails one of these
/// checks; the message ends with `advice`.
Result<void> check_parallel(const SliceStack& stack, int first, int last,
                            const std::string& advice);

}  // namespace trocar::pipeline
