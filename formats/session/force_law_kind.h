// SPDX-License-Identifier: Apache-2.0
// The names of the force laws that scenes and the command line know, and what a scene's reader must know
// about each. The laws themselves are in runtime/force_law.
// Tests: tests/runtime/force_law/force_law_table_test.cpp
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace trocar {

/// Index of a law's row in the table of laws. Values beyond the last enumerator belong to laws that
/// add_force_law() added.
enum class ForceLawKind : std::uint8_t {
  kHooke,    ///< each sheet is a spring, F = K dx
  kNetwork,  ///< each sheet is a spring network (runtime/deformation)
  kCutting,  ///< one bone volume that the tool cuts through (runtime/bone_cutting)
};

struct ForceLawTraits {
  const char* name;  ///< name in scenes and on the command line
  /// The law accepts a scene's `body` and reads HU under the tool (Sheet::field).
  bool uses_bone_volume = false;
};

/// The shipped laws, in the order of ForceLawKind.
inline constexpr std::array kForceLaws{ForceLawTraits{"hooke"}, ForceLawTraits{"network"},
                                       ForceLawTraits{"cutting", true}};
static_assert(kForceLaws.size() == static_cast<std::size_t>(ForceLawKind::kCutting) + 1,
              "a row for each ForceLawKind");

const ForceLawTraits& traits_of(ForceLawKind law) noexcept;
inline const char* to_string(ForceLawKind law) noexcept {
  return traits_of(law).name;
}
/// The law of that name, or std::nullopt.
std::optional<ForceLawKind> force_law_from_string(std::string_view name) noexcept;
/// All names as a list with "or", each between two `quote`s; for messages.
std::string force_law_names(const std::string& quote = "");

/// Adds a row. Only runtime::add_force_law() calls it. Not safe while another thread reads the
/// rows.
ForceLawKind add_force_law(const ForceLawTraits& traits);

}  // namespace trocar
