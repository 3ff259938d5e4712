// SPDX-License-Identifier: Apache-2.0
// What every sweep's program does: a plan is read from standard input, what was measured is written
// to standard output, both JSON.
#pragma once

#include <cstdio>
#include <exception>
#include <iostream>
#include <nlohmann/json.hpp>

#include "formats/base/result.h"

namespace trocar::test {

/// main() of the sweep `name`. `measure(plan)` gives a Result<json> or a json; a plan without a
/// value that it asks for is bad usage.
template <typename Measure>
int sweep_main(const char* name, const Measure& measure) {
  try {
    const Result<nlohmann::json> out = measure(nlohmann::json::parse(std::cin));
    if (!out) {
      std::fprintf(stderr, "%s: %s\n", name, out.error().message.c_str());
      return static_cast<int>(out.error().code);
    }
    std::cout << out->dump(1) << '\n';
    return 0;
  } catch (const nlohmann::json::exception& e) {
    std::fprintf(stderr, "%s: the plan: %s\n", name, e.what());
    return static_cast<int>(ExitCode::kUsage);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s: %s\n", name, e.what());
    return static_cast<int>(ExitCode::kBug);
  }
}

}  // namespace trocar::test
