// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/force_law_table.h"

#include "runtime/haptics/bone/cutting_force_law.h"
#include "runtime/haptics/membrane/sheet_law.h"

namespace trocar::runtime {
namespace {

/// The factories of the shipped laws, in the order of kForceLaws.
constexpr auto kFactories =
    std::to_array<ForceLawFactory>({make_hooke_law, make_network_law, make_cutting_law});
static_assert(kFactories.size() == kForceLaws.size(), "each law of kForceLaws needs a factory");

/// The factories of all laws, indexed by ForceLawKind.
std::vector<ForceLawFactory>& factories() {
  static std::vector<ForceLawFactory> table(kFactories.begin(), kFactories.end());
  return table;
}

}  // namespace

Result<std::unique_ptr<ForceLaw>> make_force_law(const ForceLawSetup& setup) {
  return factories().at(static_cast<std::size_t>(setup.scene.force_law.kind))(setup);
}

ForceLawKind add_force_law(const ForceLawTraits& traits, ForceLawFactory factory) {
  const ForceLawKind kind = trocar::add_force_law(traits);
  factories().push_back(factory);
  return kind;
}

}  // namespace trocar::runtime
