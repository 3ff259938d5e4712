// SPDX-License-Identifier: Apache-2.0
// main() of the sweep programs: reads a plan from standard input and writes the measurements to
// standard output, both as JSON.
#pragma once

#include <cstdio>
#include <exception>
#include <iostream>
#include <nlohmann/json.hpp>

#include "formats/base/result.h"

namespace trocar::test {

/// main() of the sweep `name`. `measure(plan)` returns a Result<json> or a json. A plan without a
/// value that it needs is wrong usage (exit code 2).
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
