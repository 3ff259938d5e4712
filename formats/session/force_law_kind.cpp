// SPDX-License-Identifier: Apache-2.0
#include "formats/session/force_law_kind.h"

#include <deque>

namespace trocar {
namespace {

/// A deque, so that references from traits_of() stay valid when a row is added.
std::deque<ForceLawTraits>& rows() {
  static std::deque<ForceLawTraits> table(kForceLaws.begin(), kForceLaws.end());
  return table;
}

}  // namespace

const ForceLawTraits& traits_of(ForceLawKind law) noexcept {
  return rows()[static_cast<std::size_t>(law)];
}

std::optional<ForceLawKind> force_law_from_string(std::string_view name) noexcept {
  for (std::size_t i = 0; i < rows().size(); ++i) {
    if (name == rows()[i].name) return static_cast<ForceLawKind>(i);
  }
  return std::nullopt;
}

std::string force_law_names(const std::string& quote) {
  std::string names;
  for (std::size_t i = 0; i < rows().size(); ++i) {
    const char* before = i == 0 ? "" : i + 1 < rows().size() ? ", " : " or ";
    names.append(before).append(quote).append(rows()[i].name).append(quote);
  }
  return names;
}

ForceLawKind add_force_law(const ForceLawTraits& traits) {
  rows().push_back(traits);
  return static_cast<ForceLawKind>(rows().size() - 1);
}

}  // namespace trocar
