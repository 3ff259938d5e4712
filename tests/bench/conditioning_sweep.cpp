// SPDX-License-Identifier: Apache-2.0
// Measures rounding errors (conditioning.h). In: a plan as JSON on stdin; out: JSON. No result
// depends on the machine's speed.
//
// Plan: {"predicate_inputs": n, "network_side": n, "poses": n, "allocations": n}
#include <string>

#include "tests/bench/conditioning.h"
#include "tests/bench/sweep_main.h"

namespace trocar::test {
namespace {

Result<nlohmann::json> measure(const nlohmann::json& plan) {
  for (const char* key : {"predicate_inputs", "network_side", "poses", "allocations"}) {
    if (plan.at(key).get<int>() < 1) return usage(std::string(key) + " must be >= 1");
  }
  if (plan["network_side"] < 4 || plan["network_side"] > 32)
    return usage("network_side must be within 4 and 32");
  return nlohmann::json{{"predicates", predicate_rows(plan["predicate_inputs"])},
                        {"network", network_rows(plan["network_side"])},
                        {"jacobian", jacobian_rows(plan["poses"])},
                        {"allocation", allocation_rows(plan["allocations"])}};
}

}  // namespace
}  // namespace trocar::test

int main() {
  return trocar::test::sweep_main("conditioning_sweep", trocar::test::measure);
}
