// SPDX-License-Identifier: Apache-2.0
// Measures in a dry run what a hand would notice as unlike bone: a tool that sinks in elastically and then snaps,
// forces that alternate from tick to tick, and a plate that is thrown out when the hand lets go.
// Tests: tests/runtime/checking/contact_feel_test.cpp
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "formats/session/recording.h"

namespace trocar::runtime {

/// A largest value and when it occurred.
struct Peak {
  double value = 0, t_s = 0;
  void include(double candidate, double at_s) noexcept {
    if (candidate > value) *this = {candidate, at_s};
  }
};

struct ContactFeel {
  // Force law `cutting` only.
  /// Depth past the cutting front that bears it of the tip of a tool that is fixed to the plate, m.
  Peak past_front;
  /// Distance over which the front cuts, or the tip falls, in one tick, m.
  Peak front_jump;
  // Every force law.
  /// Force that alternates from tick to tick, N: the smallest of kAlternations successive changes of a component
  /// of the wanted force, each against the last.
  Peak alternation;
  double wanted_least_N = 0;                      ///< least wanted force along z
  Peak wanted_most;                               ///< largest wanted force along z, N
  double contact_from_s = -1, contact_to_s = -1;  ///< first and last tick with force; -1: none
  // After the hand has let go.
  double let_go_distance_m = 0;     ///< largest distance of the plate from where it was
  double let_go_speed_m_per_s = 0;  ///< largest speed of the plate
};

class ContactFeelMeter {
 public:
  static constexpr int kAlternations = 4;

  /// `tip_plate_m`: the tool's tip in the plate's frame.
  ContactFeelMeter(const Eigen::Vector3d& tip_plate_m, std::optional<double> let_go_t_s)
      : tip_plate_m_(tip_plate_m), let_go_t_s_(let_go_t_s) {}

  /// Takes a row of the state `running`. The rows must be in order.
  void add(const RecordingRow& row) noexcept;
  const ContactFeel& feel() const noexcept { return feel_; }

 private:
  void add_front(const RecordingRow& row) noexcept;
  void add_alternation(const RecordingRow& row) noexcept;
  void add_let_go(const RecordingRow& row) noexcept;

  Eigen::Vector3d tip_plate_m_;
  std::optional<double> let_go_t_s_;
  ContactFeel feel_;
  bool has_last_ = false;
  RecordingRow last_;  ///< the row before
  /// The last changes of each component of the wanted force, the latest first.
  std::array<std::array<double, kAlternations>, 3> changes_N_{};
  std::optional<Eigen::Vector3d> let_go_p_m_;
};

}  // namespace trocar::runtime
