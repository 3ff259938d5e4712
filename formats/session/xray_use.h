// SPDX-License-Identifier: Apache-2.0
// How much X-ray a session used. Live page, report and replay all count it from the rows of the
// ticks, so they agree with each other and with the recording.
#pragma once

#include <cstdint>

#include "formats/session/recording.h"

namespace trocar {

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
