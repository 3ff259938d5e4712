// SPDX-License-Identifier: Apache-2.0
// Measures what rounding does (conditioning.h). In: a plan as JSON on stdin; out: JSON. Nothing
// here depends on the machine's speed.
//
// Plan: {"predicate_inputs": n, "network_side": n, "poses": n, "allocations": n}
#include <cstdio>
#include <exception>
#include <iostream>

#include "tests/bench/conditioning.h"

int main() {
  try {
    const nlohmann::json plan = nlohmann::json::parse(std::cin);
    for (const char* key : {"predicate_inputs", "network_side", "poses", "allocations"}) {
      if (plan.at(key).get<int>() < 1) {
        std::fprintf(stderr, "conditioning_sweep: %s must be >= 1\n", key);
        return 2;
      }
    }
    if (plan["network_side"] < 4 || plan["network_side"] > 32) {
      std::fprintf(stderr, "conditioning_sweep: network_side must be within 4 and 32\n");
      return 2;
    }
    const nlohmann::json out = {
        {"predicates", trocar::test::predicate_rows(plan["predicate_inputs"])},
        {"network", trocar::test::network_rows(plan["network_side"])},
        {"jacobian", trocar::test::jacobian_rows(plan["poses"])},
        {"allocation", trocar::test::allocation_rows(plan["allocations"])}};
    std::cout << out.dump(1) << '\n';
    return 0;
  } catch (const nlohmann::json::exception& e) {
    std::fprintf(stderr, "conditioning_sweep: the plan: %s\n", e.what());
    return 2;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "conditioning_sweep: %s\n", e.what());
    return 1;
  }
}
