// SPDX-License-Identifier: Apache-2.0
// A dry run of a scene with the simulated device, and what a hand would notice in it.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/device/hand_device.h"
#include "runtime/haptics/sheet.h"
#include "runtime/session/session.h"

namespace trocar::runtime {

// Measures, in a dry run, what a hand would notice as unlike bone: a tool that sinks in
// elastically and then snaps, forces that alternate from tick to tick, and a plate that is pushed
// away when the hand lets go.

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

// A dry run: a session over the scene with the simulated device, in virtual time, which writes no
// files (`trocar-run check`). Up to kMaxDryRunTicks ticks, the result of a dry run is exactly
// that of a session in virtual time with the same options.

/// The device with which a scene is checked.
struct DeviceToCheck {
  const DeviceSpecification& specification;
  /// Makes a simulated device of this kind, held by the scene's hand and ready for its first tick.
  /// Errors: kRefused if the device cannot reach the pose at which the hand begins.
  std::function<Result<std::shared_ptr<HandDevice>>(const Scene& scene)> simulate;
  /// Adapts the session's options, such as the coupling, to a proposed scene. Empty: the options do
  /// not depend on the scene.
  std::function<void(const Scene& scene, SessionOptions& options)> set_options = {};
};

/// Largest number of ticks of a dry run: a minute at 1 kHz. So a dry run takes at most a few
/// seconds.
inline constexpr std::uint64_t kMaxDryRunTicks = 60'000;

/// Result of a dry run for one sheet.
struct SheetDryRun {
  bool touched = false;    ///< the sheet bore force or was punctured
  double touched_t_s = 0;  ///< time at which the sheet first bore force or was punctured
  double loaded_t_s = 0;   ///< last time at which the sheet bore force
  /// The larger of two forces: the largest wanted force along z while the sheet bore force, and the
  /// largest rendered force on the tip in a tick before a puncture of the sheet.
  double force_max_N = 0;
  double punctured_t_s = -1;  ///< time of the first puncture; -1: none
  bool missed = false;        ///< the tool passed the sheet with too little material under the tool
};

struct DryRun {
  std::uint64_t ticks = 0;          ///< number of ticks done
  std::uint64_t session_ticks = 0;  ///< number of ticks of the whole session
  /// True if the dry run had no fault, but ended before the session would end.
  bool is_shortened() const noexcept { return ticks < session_ticks && fault == Fault::kNone; }
  FaultDetail fault;
  double fault_t_s = 0;
  RecordingRow at_fault;            ///< row of the tick in which the fault was found
  double tip_lowest_m = 0;          ///< lowest height of the tip before any fault
  std::vector<SheetDryRun> sheets;  ///< one result for each sheet, in the order of the argument
  /// Largest force delivered to the hand, and largest motor torque.
  double force_max_N = 0, torque_max_Nm = 0;
  std::uint64_t scaled_ticks = 0;   ///< ticks in which the device could not render the whole wrench
  double scale_min = 1;             ///< smallest fraction of the wrench rendered in these ticks
  double scaled_t_s = 0;            ///< time of the first of these ticks
  ContactFeel feel;                 ///< the contact as a hand would feel it
  std::optional<Error> hole_error;  ///< error of the first hole that could not be cut
};

/// The result of several dry runs, in each of which the hand lets go at another time.
struct LetGoTrial {
  int moments = 0;             ///< number of dry runs
  double t_s = 0;              ///< time of letting go in the run in which the plate became fastest
  double distance_m = 0;       ///< largest motion of the plate after letting go, over all runs
  double speed_m_per_s = 0;    ///< largest speed of the plate after letting go, over all runs
  Fault fault = Fault::kNone;  ///< the fault of the first run that had one, or none
};

inline constexpr int kLetGoMoments = 10;
inline constexpr double kLetGoAfter_s = 0.4;
/// Does kLetGoMoments dry runs in which the hand lets go during the contact that `dry_run` had. In
/// the first run the hand lets go at the largest force along z. In the other runs the hand lets go
/// at evenly spaced times of the contact. Each run ends kLetGoAfter_s after the hand has let go, or
/// at the session's end if that is earlier. Returns none if `dry_run` has a fault, or if `dry_run`
/// has no contact before the scene's hand lets go. `is_enough`: if given, no further runs are done
/// once it is true of the result so far. Errors: those of run_dry_run(); kRefused if
/// SessionOptions::stop was set.
Result<std::optional<LetGoTrial>> try_letting_go(
    const Scene& scene, const DeviceToCheck& device,
    const std::vector<std::unique_ptr<const Sheet>>& sheets, const SessionOptions& options,
    const DryRun& dry_run, const std::function<bool(const LetGoTrial&)>& is_enough = {});

/// Runs a dry run. `options`: the options of the session. Errors: those of DeviceToCheck::simulate
/// and of make_force_law().
Result<DryRun> run_dry_run(const Scene& scene, const DeviceToCheck& device,
                           const std::vector<std::unique_ptr<const Sheet>>& sheets,
                           const SessionOptions& options);

}  // namespace trocar::runtime
