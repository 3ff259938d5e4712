// SPDX-License-Identifier: Apache-2.0
// Faults that the stand-in injects into its answers at given times.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace trocar::haply_stand_in {

enum class FaultKind {
  kSilence,
  kLate,
  kTwice,
  kGarbage,
  kBadUtf8,
  kTruncated,
  kBinary,
  kHuge,
  kDeep,
  kWrongTypes,
  kNull,
  kNan,
  kBigNumber,
  kOverflow,
  kJump,
  kFrozen,
  kOtherId,
  kMissingDevice,
  kRemoved,
  kNoInverse3,
  kNoState,
  kNotReady,
  kDisconnect,
  kClose,
  kRestart,
};

struct Fault {
  FaultKind kind = FaultKind::kSilence;
  std::string name;
  double at_s = 0;                   // after the first force
  std::optional<double> duration_s;  // none: one answer
  int answers = 0;                   // how many answers it has changed
  double first_s = 0;                // when it changed the first one
};

/// Reads "KIND@SECONDS[:DURATION]". Throws std::runtime_error with one line.
Fault parse_fault(const std::string& text);

/// One line for each kind with its meaning.
std::string fault_help();

/// Returns the first fault of the list that applies to an answer at `now_s`, and counts it there; null if there is none.
Fault* take_fault(std::vector<Fault>& faults, double now_s);

}  // namespace trocar::haply_stand_in
