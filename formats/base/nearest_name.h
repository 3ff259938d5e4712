// SPDX-License-Identifier: Apache-2.0
// Suggestions for misspelt names: "--treshold": did you mean --threshold?
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace trocar {

/// The candidate with the smallest edit distance (Levenshtein) to `name`; empty if all are farther
/// than a third of the name's length (at least 1) or the name has more than 64 bytes.
std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates);

/// ", did you mean X?" or nothing.
std::string did_you_mean(std::string_view name, const std::vector<std::string>& candidates);

/// One line on the first word of the command line that no option took. `App` is CLI::App; a
/// template, so that this folder need not know CLI11.
template <typename App>
std::string unexpected_word(const App& app) {
  const std::vector<std::string> rest = app.remaining(true);
  const std::string word = rest.empty() ? "" : rest.front();
  const App& where = app.get_subcommands().empty() ? app : *app.get_subcommands().front();
  std::vector<std::string> names;
  for (const auto* option : where.get_options()) {
    for (const std::string& name : option->get_lnames())
      names.push_back("--" + name);
  }
  return "not expected: " + word + did_you_mean(word.substr(0, word.find('=')), names) + " (see " +
         app.get_name() + " --help)";
}

/// One line on the first word that is an empty value (a shell's unset variable, which CLI11 takes
/// for no option at all), or nothing.
std::string empty_value(int count, const char* const* words);

}  // namespace trocar
