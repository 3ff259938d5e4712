// SPDX-License-Identifier: Apache-2.0
// The number of ticks of a session, and the rate of the ticks in a recording.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "formats/base/result.h"
#include "formats/session/recording.h"

namespace trocar::runtime {

/// Returns the number of ticks of a session, at least 1. The ticks are at the times 0, 1/rate,
/// 2/rate, ... before `duration_s`.
std::uint64_t tick_count(double duration_s, double rate_Hz);

/// Returns the rate at which a recording was made. A rate fits if the time of row k equals
/// k / rate, bit for bit, for every row k. `stated_Hz`: the rate that the recording states; 0: none
/// is stated. If several rates fit, the function returns the stated rate if this rate fits,
/// otherwise the rate with the fewest decimal digits. `name`: the recording's name, for error
/// messages. Errors: kRefused if there are fewer than two rows, if the first time is not 0, if the
/// rate is outside kMinRate_Hz to kMaxRate_Hz, or if no rate fits.
Result<double> recorded_rate_Hz(std::span<const RecordingRow> rows, const std::string& name,
                                double stated_Hz = 0);

}  // namespace trocar::runtime
