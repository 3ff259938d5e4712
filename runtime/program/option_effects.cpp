// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/option_effects.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <span>
#include <string>
#include <string_view>

namespace trocar::runtime {
namespace {

using Names = std::span<const std::string_view>;  ///< names of options, without their dashes

// The console and scripts give these options to everything that uses a device, so they are taken even
// where some of them mean nothing.
constexpr std::string_view kOfDevice[] = {"device",    "key-file",    "device-description",
                                          "simulated", "force-limit", "force-scale",
                                          "rate",      "quiet"};
constexpr std::string_view kOfHistory[] = {"output", "quiet"};
constexpr std::string_view kOfExplanation[] = {"procedure", "quiet"};
constexpr std::string_view kOfTest[] = {"duration", "summary", "cpu", "late-ticks-in-row"};
// Settings of the sessions that are tried.
constexpr std::string_view kOfTrials[] = {"compensate", "passivity", "coupling", "energy-limit",
                                          "stiffness-limit"};
constexpr std::string_view kOfNewScene[] = {"output", "entry", "target", "live-hand"};
constexpr std::string_view kOfCheck[] = {"SCENE",     "strict",   "asset",   "force-law",
                                         "procedure", "strength", "duration"};
// Settings and files of the session that is checked. They do not change the check, but --check may be
// added to the command of a session.
constexpr std::string_view kOfCheckedSession[] = {
    "clock",          "cpu",    "recover",   "late-ticks-in-row", "late-ticks", "record", "summary",
    "session-report", "meshes", "hand-path", "black-box",         "trainee",    "course", "attempt",
    "frames",         "live",   "xray"};

/// A replacement of the session.
struct Replacement {
  std::string_view option;  ///< the option that selects it
  bool is_given;
  std::array<Names, 4> effective;  ///< the options that have an effect, besides `option`
};

}  // namespace

Result<void> check_option_effects(const CommandLine& line, const RunArguments& a) {
  // In the order in which trocar-run chooses one.
  const Replacement replacements[] = {
      {"explain", a.explain, {kOfExplanation}},
      {"history", !a.history.empty(), {kOfHistory}},
      {"test", a.test_device, {kOfDevice, kOfTest}},
      {"new-scene", !a.new_scene.empty(), {kOfDevice, kOfTrials, kOfNewScene}},
      {"check", a.check, {kOfDevice, kOfTrials, kOfCheck, kOfCheckedSession}}};
  const auto* const given = std::find_if(std::begin(replacements), std::end(replacements),
                                         [](const Replacement& each) { return each.is_given; });
  if (given == std::end(replacements)) return {};
  for (const Option& option : line.options()) {
    const std::string name = option.bare_name();
    const bool has_effect =
        name == given->option ||
        std::any_of(given->effective.begin(), given->effective.end(), [&](Names names) {
          return std::find(names.begin(), names.end(), name) != names.end();
        });
    if (option.is_given() && !has_effect)
      return usage("--" + name + ": has no effect with --" + std::string(given->option) +
                   "; leave it out");
  }
  return {};
}

}  // namespace trocar::runtime
