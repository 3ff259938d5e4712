// SPDX-License-Identifier: Apache-2.0
// The names of the force laws in scenes and on the command line, and the traits of each law that a
// program needs to read a scene. The laws themselves are in runtime/force_law.
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
  kHooke,    ///< each slice is an elastic sheet: a spring, F = K dx
  kNetwork,  ///< each slice is an elastic sheet: a spring network (runtime/deformation)
  kCutting,  ///< the slices are one bone volume, which the tool cuts (runtime/bone_cutting)
};

struct ForceLawTraits {
  const char* name;  ///< name in scenes and on the command line
  /// True if the law uses a bone volume: the law accepts a scene's `body`, and reads the HU under
  /// the tool from Sheet::field.
  bool uses_bone_volume = false;
};

/// The shipped laws, in the order of ForceLawKind.
inline constexpr std::array kForceLaws{ForceLawTraits{"hooke"}, ForceLawTraits{"network"},
                                       ForceLawTraits{"cutting", true}};
static_assert(kForceLaws.size() == static_cast<std::size_t>(ForceLawKind::kCutting) + 1,
              "a row for each ForceLawKind");

/// The row of a law. Precondition: the table has this law.
const ForceLawTraits& traits_of(ForceLawKind law) noexcept;
inline const char* to_string(ForceLawKind law) noexcept {
  return traits_of(law).name;
}
/// The law of that name, or std::nullopt.
std::optional<ForceLawKind> force_law_from_string(std::string_view name) noexcept;
/// All names for a message, such as "hooke, network or cutting". `quote` is written before and
/// after each name.
std::string force_law_names(const std::string& quote = "");

/// Adds a row to the table. Only runtime::add_force_law() may call this function, and only while no
/// other thread reads the table.
ForceLawKind add_force_law(const ForceLawTraits& traits);

}  // namespace trocar
