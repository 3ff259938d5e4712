// SPDX-License-Identifier: Apache-2.0
// The settings of the stand-in library, from the environment (README.md lists them).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "tests/stand_ins/force_dimension/simulated_arm.h"

namespace stand_in {

enum class FaultKind {
  kSilence,
  kLate,
  kError,
  kReadError,
  kNan,
  kSkew,
  kJump,
  kFrozen,
  kSame,
  kDisconnect,
  kNoDevice,
  kOpenFails,
  kUncalibrated
};

struct Fault {
  FaultKind kind;
  int code = 0;  ///< the error number of kError
  double start_s = 0;
  double end_s = 0;
};

struct Settings {
  std::string model = "omega.3";
  bool has_wrist = false;
  bool has_active_wrist = false;
  std::vector<int> serials;  ///< serial numbers of the devices that are connected
  std::vector<Keyframe> path;
  std::string log;
  std::vector<Fault> faults;
  std::string error;  ///< names the setting that cannot be read; empty if there is none
};

/// The values of all variables in one text, to find out whether they have changed.
std::string environment();
Settings read_settings();
/// Parses KIND@SECONDS[:DURATION],... Sets `error` if it cannot.
std::vector<Fault> parse_faults(std::string_view text, std::string& error);

}  // namespace stand_in
