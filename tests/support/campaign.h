// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cstdlib>

namespace trocar::test {

/// How many random cases a test runs: `usual`, or that times TROCAR_CAMPAIGN (`scripts/nightly
/// random`: 100).
inline int campaign(int usual) {
  const char* const times = std::getenv("TROCAR_CAMPAIGN");  // NOLINT(concurrency-mt-unsafe)
  return times == nullptr ? usual : usual * std::max(1, std::atoi(times));
}

}  // namespace trocar::test
