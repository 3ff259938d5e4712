// SPDX-License-Identifier: Apache-2.0
// Who did a session, in which course, and in which attempt. A code stands for the trainee, so no
// name has to be stored. The origin of a recording (recording.h) has these values in the
// entries `trainee`, `course` and `attempt`.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/recording.h"

namespace trocar {

inline constexpr std::size_t kMaxTraineeCode = 32;
inline constexpr std::int64_t kMaxAttempt = 9999;

struct Trainee {
  std::string code, course;             ///< empty: not given
  std::optional<std::int64_t> attempt;  ///< counted from 1

  bool is_stated() const { return !code.empty() || !course.empty() || attempt.has_value(); }
};

/// Returns true if the text has 1 to 32 characters, each an ASCII letter, a digit, '-' or '_'.
bool is_trainee_code(std::string_view text);

/// trainee_code_error() checks a code or a course, attempt_error() a number. If the value is wrong,
/// the result is a text for a message, such as "must be 1 to 32 letters, digits, - or _"; otherwise
/// it is empty. An empty code or course is valid: it means that none is given.
std::string trainee_code_error(std::string_view code);
std::string attempt_error(std::int64_t attempt);

/// {"code": TEXT or null, "course": TEXT or null, "attempt": NUMBER or null}; null if nothing is
/// given. Precondition: code and course are valid.
std::string to_json(const Trainee& trainee);

/// Adds an entry to `origin` for each value that is given.
void state_trainee(const Trainee& trainee, RecordingOrigin& origin);

/// Reads the entries that state_trainee() wrote. Errors: kRefused if a value is wrong.
Result<Trainee> stated_trainee(const RecordingOrigin& origin);

// How much X-ray a session used. Live page, report and replay all count it from the rows of the
// ticks, so they agree with each other and with the recording.

struct XrayUse {
  std::uint64_t shots = 0;            ///< single pictures
  std::uint64_t screening_ticks = 0;  ///< ticks with continuous X-ray (screening)
  bool is_screening = false;          ///< continuous X-ray was on in the last tick

  void add(const RecordingRow& row) noexcept {
    shots += (row.xray & kXrayPicture) != 0 ? 1 : 0;
    is_screening = (row.xray & kXrayBeam) != 0;
    screening_ticks += is_screening ? 1 : 0;
  }
  double screening_s(double rate_Hz) const noexcept {
    return static_cast<double>(screening_ticks) / rate_Hz;
  }
};

}  // namespace trocar
