// SPDX-License-Identifier: Apache-2.0
#include "formats/base/text.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>

namespace trocar {
namespace {

TEST(UtcTime, DoesNotDependOnTheTimeZone) {
  for (const char* zone : {"UTC", "Asia/Tokyo", "America/New_York", "XXX-5:30"}) {
    ::setenv("TZ", zone, 1);
    ::tzset();
    EXPECT_EQ(utc_text(1'796'016'878), "2026-11-30T05:34:38Z") << zone;
    EXPECT_EQ(utc_name(1'796'016'878), "20261130T053438Z") << zone;
  }
  ::unsetenv("TZ");
  ::tzset();
}

TEST(UtcTime, ATimeThatNoCalendarHasIsThatOfZero) {
  EXPECT_EQ(utc_text(std::numeric_limits<std::time_t>::max()), "1970-01-01T00:00:00Z");
}

}  // namespace
}  // namespace trocar
