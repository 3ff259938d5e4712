// SPDX-License-Identifier: Apache-2.0
// The number of ticks of a session, and their rate.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "formats/base/result.h"
#include "formats/session/recording.h"

namespace trocar::runtime {

/// Returns the number of ticks of a session. Ticks are at the times 0, 1/rate, 2/rate, ... that are
/// before the end.
std::uint64_t tick_count(double duration_s, double rate_Hz);

/// Returns the rate at which a recording was made: its times are then k / rate, bit for bit. If
/// several rates fit, `stated_Hz` (0: none) is preferred, and otherwise the shortest decimal.
/// Errors: (refused) no rate fits.
Result<double> recorded_rate_Hz(std::span<const RecordingRow> rows, const std::string& name,
                                double stated_Hz = 0);

}  // namespace trocar::runtime
