// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/console_state.h"

#include <cstdio>

#include "formats/base/terminal_text.h"

namespace trocar::runtime {

void RefusalLog::refused(const char* kind, const std::string& from) {
  if (reported_.insert(kind).second)
    print(stderr, "trocar-console: refused: %s, from %s (further ones are not reported)\n", kind,
          from);
}

void RefusalLog::emergency_stop(const std::string& from) {
  constexpr auto kQuiet = std::chrono::seconds(10);
  const auto now = std::chrono::steady_clock::now();
  if (last_stop_ && now - *last_stop_ < kQuiet) return;
  last_stop_ = now;
  print(stderr, "trocar-console: emergency stop, asked for from %s\n", from);
}

}  // namespace trocar::runtime
