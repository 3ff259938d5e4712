// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/programs/device_choice.h"

#include <algorithm>

namespace trocar::runtime {
namespace {

/// The options that have a value. The option `simulated` has none.
constexpr std::string_view kWithValue[] = {"key-file", "device-description", "force-limit",
                                           "force-scale"};

/// Returns the text before the next comma, and removes both from `rest`.
std::string_view take_part(std::string_view& rest) {
  const std::size_t comma = rest.find(',');
  const std::string_view part = rest.substr(0, comma);
  rest.remove_prefix(comma == std::string_view::npos ? rest.size() : comma + 1);
  return part;
}

}  // namespace

bool DeviceChoice::has(std::string_view word) const {
  return std::find(words.begin(), words.end(), word) != words.end();
}

bool DeviceChoice::is_simulated() const {
  return !can_be_tested() || has("--simulated");
}

Result<DeviceChoice> parse_device_choice(std::string_view text) {
  const std::string shown = "--device " + std::string(text);
  std::string_view rest = text;
  DeviceChoice choice{std::string(take_part(rest)), {}};
  while (!rest.empty() || text.ends_with(',')) {
    const std::string_view part = take_part(rest), name = part.substr(0, part.find('='));
    const bool has_value =
        std::find(std::begin(kWithValue), std::end(kWithValue), name) != std::end(kWithValue);
    const std::string_view value = part.substr(std::min(part.size(), name.size() + 1));
    if (has_value ? value.empty() : part != "simulated")
      return usage(shown +
                   ": after the device may follow ,key-file=FILE ,device-description=FILE "
                   ",force-limit=N ,force-scale=F or ,simulated");
    std::string word = "--" + std::string(name);
    if (choice.has(word)) return usage(shown + ": " + std::string(name) + " is given twice");
    choice.words.push_back(std::move(word));
    if (has_value) choice.words.emplace_back(value);
  }
  return choice;
}

void HiddenTexts::add(const std::string& text, const std::string& shown) {
  if (text.empty()) return;
  const auto at = std::find_if(entries_.begin(), entries_.end(),
                               [&](const Entry& entry) { return entry.text.size() < text.size(); });
  entries_.insert(at, {text, shown});
}

void HiddenTexts::add(const DeviceChoice& device) {
  for (std::size_t i = 1; i < device.words.size(); ++i) {
    if (device.words[i].find('/') != std::string::npos)
      add(device.words[i], "the file of " + device.words[i - 1].substr(2));
  }
}

std::string HiddenTexts::hide(std::string text) const {
  for (const auto& [hidden, shown] : entries_) {
    for (std::size_t at = text.find(hidden); at != std::string::npos;
         at = text.find(hidden, at + shown.size()))
      text.replace(at, hidden.size(), shown);
  }
  return text;
}

}  // namespace trocar::runtime
