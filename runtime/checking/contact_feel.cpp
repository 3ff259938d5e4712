// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/contact_feel.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar::runtime {
namespace {

constexpr double kContact_N = 0.5;

Eigen::Vector3d plate_of(const RecordingRow& row) noexcept {
  return Eigen::Vector3d(row.p_m.data());
}

}  // namespace

void ContactFeelMeter::add(const RecordingRow& row) noexcept {
  feel_.wanted_least_N = std::min(feel_.wanted_least_N, row.wrench_wanted[2]);
  feel_.wanted_most.include(row.wrench_wanted[2], row.t_s);
  if (Eigen::Vector3d(row.wrench_wanted.data()).norm() > kContact_N) {
    if (feel_.contact_from_s < 0) feel_.contact_from_s = row.t_s;
    feel_.contact_to_s = row.t_s;
  }
  if (has_last_) {
    add_front(row);
    add_alternation(row);
  }
  add_let_go(row);
  last_ = row;
  has_last_ = true;
}

void ContactFeelMeter::add_front(const RecordingRow& row) noexcept {
  if (row.tip_N > 0) {
    const Eigen::Quaterniond q(row.q[0], row.q[1], row.q[2], row.q[3]);
    const Eigen::Vector3d tip_m = plate_of(row) + q * tip_plate_m_;
    feel_.past_front.include(row.cutting.front_z_m - tip_m.z(), row.t_s);
  }
  // A front that has reached a gap is the next bone below, which the tip may not have reached.
  if (row.cutting.cut_J > last_.cutting.cut_J)
    feel_.front_jump.include(
        last_.cutting.front_z_m - std::max(row.cutting.front_z_m, row.tool_m[2]), row.t_s);
}

void ContactFeelMeter::add_alternation(const RecordingRow& row) noexcept {
  for (std::size_t axis = 0; axis < changes_N_.size(); ++axis) {
    auto& changes = changes_N_[axis];
    std::rotate(changes.begin(), changes.end() - 1, changes.end());
    changes[0] = row.wrench_wanted[axis] - last_.wrench_wanted[axis];
    double least_N = std::abs(changes[0]);
    for (std::size_t i = 1; i < changes.size(); ++i)
      least_N = changes[i] * changes[i - 1] < 0 ? std::min(least_N, std::abs(changes[i])) : 0;
    feel_.alternation.include(least_N, row.t_s);
  }
}

void ContactFeelMeter::add_let_go(const RecordingRow& row) noexcept {
  if (!let_go_t_s_ || row.t_s < *let_go_t_s_) return;
  if (!let_go_p_m_) {
    let_go_p_m_ = plate_of(row);
    return;
  }
  feel_.let_go_distance_m =
      std::max(feel_.let_go_distance_m, (plate_of(row) - *let_go_p_m_).norm());
  if (row.t_s > last_.t_s)
    feel_.let_go_speed_m_per_s =
        std::max(feel_.let_go_speed_m_per_s,
                 (plate_of(row) - plate_of(last_)).norm() / (row.t_s - last_.t_s));
}

}  // namespace trocar::runtime
