// SPDX-License-Identifier: Apache-2.0
// Times of day in texts and in names of files. They are UTC and end in Z, whatever the time zone of
// the computer is.
#pragma once

#include <ctime>
#include <string>

namespace trocar {

/// "2026-11-30T05:34:38Z" (RFC 3339), for texts. A time that no calendar has gives that of 0.
std::string utc_text(std::time_t time);
/// "20261130T053438Z" (ISO 8601), for names of files and folders. They sort by time.
std::string utc_name(std::time_t time);

}  // namespace trocar
