// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/force_history.h"

namespace trocar::runtime {

void ForceHistory::add(const Point& point) {
  if (!(point.t_s > last_t_s_)) return;
  last_t_s_ = point.t_s;
  if (!largest_ || point.force_N > largest_->force_N) largest_ = point;
  if (++pending_ < every_) return;
  points_.push_back(*largest_);
  pending_ = 0;
  largest_.reset();
  if (points_.size() <= kMaxPoints) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points_.size(); i += 2) {
    const bool is_next_larger =
        i + 1 < points_.size() && !(points_[i].force_N > points_[i + 1].force_N);
    points_[kept++] = points_[is_next_larger ? i + 1 : i];
  }
  points_.resize(kept);
  every_ *= 2;
}

}  // namespace trocar::runtime
