// SPDX-License-Identifier: Apache-2.0
// A trial session: the scene with the simulated device in virtual time, without outputs, to learn
// what a session would do (`trocar-run --check`). It is the session itself, so its judgement is
// that of a session in virtual time with the same options.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"
#include "runtime/session/session.h"

namespace trocar::runtime {

/// A trial ends after this many ticks, a minute at 1 kHz, so that it takes some seconds at most.
inline constexpr std::uint64_t kMaxTrialTicks = 60'000;

/// What happened to one sheet.
struct SheetTrial {
  bool touched = false;       ///< it bore force or was punctured
  double touched_t_s = 0;     ///< first
  double borne_t_s = 0;       ///< in which it bore force, last
  double force_max_N = 0;     ///< of the tool's wrench along z while the sheet bore it
  double punctured_t_s = -1;  ///< first; -1: not
  bool passed_beside = false;
};

struct Trial {
  std::uint64_t ticks = 0;          ///< done
  std::uint64_t session_ticks = 0;  ///< of the whole session
  /// A session over `session_ticks` was not tried to its end.
  bool is_cut() const noexcept { return ticks < session_ticks && fault == Fault::kNone; }
  FaultDetail fault;
  double fault_t_s = 0;
  RecordingRow at_fault;  ///< the tick of the fault
  double tip_lowest_m = 0;
  std::vector<SheetTrial> sheets;  ///< as the sheets given
  double force_max_N = 0, torque_max_Nm = 0;
  std::uint64_t scaled_ticks = 0;   ///< in which the motors could not render the whole wrench
  double scale_min = 1;             ///< smallest share that was rendered
  double scaled_t_s = 0;            ///< first
  std::optional<Error> hole_error;  ///< of the first hole that could not be cut
};

/// `options` as for the session. Refused as make_simulated_device and make_workers: a start out of
/// reach; with `network`, a tissue or tool for which calibration finds no membrane.
Result<Trial> run_trial(const Scene& scene, const DeviceDescription& description,
                        const std::vector<std::unique_ptr<const Sheet>>& sheets,
                        const SessionOptions& options);

}  // namespace trocar::runtime
