// SPDX-License-Identifier: Apache-2.0
// Measures, in a dry run (dry_run.h), what a hand would notice as unlike bone: a tool that sinks in
// elastically and then snaps, forces that alternate from tick to tick, and a plate that is pushed
// away when the hand lets go.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "formats/session/recording.h"

namespace trocar::runtime {

/// A largest value and the time at which it occurred.
struct Peak {
  double value = 0, t_s = 0;
  void include(double candidate, double at_s) noexcept {
    if (candidate > value) *this = {candidate, at_s};
  }
};

struct ContactFeel {
  // Force law `cutting` only. The cutting front is the depth down to which bone has been cut.
  /// Depth of the plate's tip below the front while the front bears force, m. The plate's tip is a
  /// point that is fixed to the plate: the position that the tool's tip has while the coupling
  /// spring between plate and virtual tool is not loaded.
  Peak past_front;
  /// Distance by which the front moves down in one tick in which bone is cut, m. When the front
  /// comes out of a bone, it jumps across the gap to the next bone below. Only the part of such a
  /// jump that is above the tip on which the tissue acts (RecordingRow::tool_m) counts.
  Peak front_jump;
  // Every force law. The wanted force is the force that the device should render.
  /// Force that alternates from tick to tick, N. For each component of the wanted force, the last
  /// kAlternations changes from tick to tick are kept. If their signs alternate, the smallest
  /// magnitude among these changes counts.
  Peak alternation;
  double wanted_least_N = 0;  ///< most negative wanted force along z; 0: none was negative
  Peak wanted_most;           ///< largest wanted force along z, N
  /// First and last time with a wanted force above 0.5 N; -1: none.
  double contact_from_s = -1, contact_to_s = -1;
  // Motion of the plate after the hand has let go.
  double let_go_distance_m = 0;     ///< largest distance from the position at letting go
  double let_go_speed_m_per_s = 0;  ///< largest speed
};

class ContactFeelMeter {
 public:
  static constexpr int kAlternations = 4;

  /// `tip_plate_m`: the tool's tip in the plate's frame. `let_go_t_s`: time at which the hand lets
  /// go; none: the hand does not let go.
  ContactFeelMeter(const Eigen::Vector3d& tip_plate_m, std::optional<double> let_go_t_s)
      : tip_plate_m_(tip_plate_m), let_go_t_s_(let_go_t_s) {}

  /// Call this for each row of a session in order, up to the first fault.
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
  RecordingRow last_;  ///< the previous row
  /// The last changes of each component of the wanted force, the latest change first.
  std::array<std::array<double, kAlternations>, 3> changes_N_{};
  std::optional<Eigen::Vector3d> let_go_p_m_;
};

}  // namespace trocar::runtime
