// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/presets.h"

#include <algorithm>
#include <array>
#include <iterator>

#include "formats/base/nearest_name.h"

namespace trocar::pipeline {
namespace {

bool gives(const std::vector<std::string>& words, std::string_view option) {
  return std::any_of(words.begin(), words.end(), [option](const std::string& word) {
    return word.starts_with(option) && (word.size() == option.size() || word[option.size()] == '=');
  });
}

const Preset* find_preset(std::string_view name) {
  const auto all = presets();
  const auto at =
      std::find_if(all.begin(), all.end(), [name](const Preset& p) { return p.name == name; });
  return at == all.end() ? nullptr : &*at;
}

// The options of the preset that the words do not give themselves.
std::vector<std::pair<std::string_view, std::string_view>> added(
    const std::vector<std::string>& words) {
  std::string name;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i].starts_with("--preset=")) name = words[i].substr(std::string("--preset=").size());
    if (words[i] == "--preset" && i + 1 < words.size()) name = words[i + 1];
  }
  std::vector<std::pair<std::string_view, std::string_view>> out;
  const Preset* preset = find_preset(name);
  if (preset == nullptr) return out;
  std::copy_if(preset->options.begin(), preset->options.end(), std::back_inserter(out),
               [&words](const auto& each) {
                 const bool other_unit =
                     each.first == "--max-area-px" && gives(words, "--max-area");
                 return !gives(words, each.first) && !other_unit;
               });
  return out;
}

}  // namespace

std::span<const Preset> presets() {
  static const std::vector<Preset> all{
      {"bone",
       "dense bone (cortical and dense cancellous), just as the threshold gives it",
       {{"--threshold", "226"}}},
      {"solid-bone",
       "bone with its inside filled and small specks dropped; canals and sinuses stay open",
       {{"--threshold", "226"}, {"--close", "3"}, {"--fill", "2500"}, {"--min-volume", "100"}}},
      {"vertebra",
       "like solid-bone with a lower threshold, which also suits vertebrae of low density",
       {{"--threshold", "180"}, {"--close", "3"}, {"--fill", "2500"}, {"--min-volume", "100"}}},
      {"column",
       "like vertebra, but the spinal column alone, without contrast-filled vessels",
       {{"--threshold", "180"},
        {"--close", "3"},
        {"--fill", "2500"},
        {"--min-volume", "100"},
        {"--keep", "column"}}},
      {"skin",
       "the surface of the body without the CT table; air inside the body is not filled",
       {{"--threshold", "-300"}, {"--fill", "all"}, {"--min-volume", "1000"}, {"--largest", "1"}}},
      {"paper",
       "the published method: equalised histogram, and outlines along pixel centres;\n"
       "  triangles with angles of at least 30 degrees, and of at most 200 pixels",
       {{"--equalize", "230"},
        {"--contour", "pixel"},
        {"--simplify", "dp"},
        {"--min-angle", "30"},
        {"--max-area-px", "200"}}},
  };
  return all;
}

std::vector<std::string> with_preset_options(const std::vector<std::string>& words) {
  std::vector<std::string> out = words;
  // After "--" there are only inputs.
  auto end = std::find(out.begin(), out.end(), "--") - out.begin();
  for (const auto& [option, value] : added(words))
    out.insert(out.begin() + end++, std::string(option).append("=").append(value));
  return out;
}

std::set<std::string> added_by_preset(const std::vector<std::string>& words) {
  std::set<std::string> out;
  for (const auto& [option, value] : added(words))
    out.emplace(option);
  return out;
}

Result<std::string> explain_presets(const std::string& name) {
  std::vector<std::string> names;
  std::string out;
  for (const Preset& preset : presets()) {
    names.emplace_back(preset.name);
    if (!name.empty() && name != preset.name) continue;
    out.append(preset.name).append(":");
    for (const auto& [option, value] : preset.options)
      out.append(" ").append(option).append(" ").append(value);
    out.append("\n  ").append(preset.words).append("\n");
  }
  if (out.empty())
    return usage("--preset " + name + ": no such preset" + did_you_mean(name, names));
  return out;
}

}  // namespace trocar::pipeline
