// SPDX-License-Identifier: Apache-2.0
#include "formats/base/json.h"

#include <algorithm>
#include <vector>

#include "formats/base/text.h"

namespace trocar {

std::string json_text(const nlohmann::json& value, int indent) {
  return value.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

// Up to the first syntax error, at which the parser ends, this finds the same strings as the parser.
bool is_nested_too_deeply(std::string_view text) noexcept {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      in_string = c != '"';
    } else if (c == '"') {
      in_string = true;
    } else if (c == '{' || c == '[') {
      if (++depth > kMaxJsonDepth) return true;
    } else if (c == '}' || c == ']') {
      --depth;
    }
  }
  return false;
}

nlohmann::json parse_json(std::string_view text) {
  if (is_nested_too_deeply(text)) return nlohmann::json::value_t::discarded;
  return nlohmann::json::parse(text, nullptr, false);
}

nlohmann::json parse_json(std::span<const std::uint8_t> text) {
  return parse_json(std::string_view(reinterpret_cast<const char*>(text.data()), text.size()));
}

nlohmann::json parse_known_json(std::string_view text) {
  return nlohmann::json::parse(text);
}

namespace {

std::string range_message(double lowest, double highest) {
  return "must be within " + json_text(lowest) + " and " + json_text(highest);
}

/// Shortens nlohmann's message "parse error at line 1, column 2: ...".
std::string why_no_json(std::string_view text, const std::string& what) {
  if (text.find_first_not_of(" \t\r\n") == std::string_view::npos) return "not JSON: it is empty";
  constexpr std::string_view kFront = "parse error at ";
  return what.starts_with(kFront) ? "not JSON: " + what.substr(kFront.size()) : what;
}

}  // namespace

Result<nlohmann::json> parse_strict_json(std::string_view text, const std::string& name) {
  if (is_nested_too_deeply(text)) return refused(name + ": nested too deeply");
  // nlohmann silently keeps the last of two equal keys. Their values may differ, so refuse both.
  std::vector<std::set<std::string>> keys;
  std::optional<std::string> wrong;
  const auto watch = [&](int, nlohmann::json::parse_event_t event, nlohmann::json& parsed) {
    using Event = nlohmann::json::parse_event_t;
    if (event == Event::object_start || event == Event::array_start) {
      keys.emplace_back();
    } else if (event == Event::object_end || event == Event::array_end) {
      keys.pop_back();
    } else if (event == Event::key) {
      const auto& key = parsed.get_ref<const std::string&>();
      if (!keys.back().insert(key).second && !wrong)
        wrong = "key " + json_text(key) + " occurs twice";
    }
    return true;
  };
  try {
    nlohmann::json value = nlohmann::json::parse(text, watch);
    if (wrong) return refused(name + ": " + *wrong);
    return value;
  } catch (const nlohmann::json::exception& failure) {
    const std::string what = failure.what();
    const std::size_t after = what.find("] ");
    return refused(name + ": " +
                   why_no_json(text, after == std::string::npos ? what : what.substr(after + 2)));
  }
}

void JsonErrors::add(const std::string& path, const std::string& why) {
  if (!first) first = refused(file + ": " + (path.empty() ? "/" : path) + ": " + why);
}

StrictObject::StrictObject(const nlohmann::json& value, std::string path, JsonErrors& errors)
    : value_(value), path_(std::move(path)), errors_(errors) {
  if (!value_.is_object()) errors_.add(path_, "must be an object");
}

const nlohmann::json* StrictObject::find(const char* key, bool required) {
  known_.insert(key);
  if (has(key)) return &value_[key];
  if (required && value_.is_object()) {
    std::vector<std::string> others;
    for (const auto& [other, unused] : value_.items())
      others.push_back(other);
    const std::string meant = nearest_name(key, others);
    errors_.add(path(key), "is missing" + (meant.empty() || known_.contains(meant)
                                               ? ""
                                               : "; is it " + json_text(meant) + "?"));
  }
  return nullptr;
}

bool StrictObject::boolean(const char* key) {
  const nlohmann::json* found = find(key, false);
  if (found == nullptr || found->is_boolean()) return found != nullptr && found->get<bool>();
  return wrong(key, "must be true or false", false);
}

double StrictObject::number(const char* key, double lowest, double highest,
                            std::optional<double> otherwise) {
  const nlohmann::json* found = find(key, !otherwise);
  if (found == nullptr) return otherwise.value_or(lowest);
  if (!found->is_number()) return wrong(key, "must be a number", lowest);
  const double x = found->get<double>();
  if (!std::isfinite(x) || x < lowest || x > highest)
    return wrong(key, range_message(lowest, highest), lowest);
  return x;
}

void StrictObject::read(const char* key, double& value, double lowest, double highest) {
  value = number(key, lowest, highest, value);
}

void StrictObject::read(const char* key, std::optional<double>& value, double lowest,
                        double highest) {
  if (find(key, false) != nullptr) value = number(key, lowest, highest);
}

std::size_t StrictObject::choice(const char* key, std::span<const char* const> names) {
  if (find(key, false) == nullptr) return 0;
  const auto found = std::find(names.begin(), names.end(), string(key));
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  std::string list;
  for (std::size_t i = 0; i < names.size(); ++i) {
    list.append(i == 0 ? "" : i + 1 < names.size() ? ", " : " or ");
    list.append("\"").append(names[i]).append("\"");
  }
  return wrong(key, "must be " + list, std::size_t{0});
}

std::int64_t StrictObject::integer(const char* key, std::int64_t lowest, std::int64_t highest,
                                   std::optional<std::int64_t> otherwise) {
  const nlohmann::json* found = find(key, !otherwise);
  if (found == nullptr) return otherwise.value_or(lowest);
  // An unsigned value above the range of int64 would wrap in get<int64_t>().
  const bool fits =
      found->is_number_integer() &&
      !(found->is_number_unsigned() && found->get<std::uint64_t>() > std::uint64_t{INT64_MAX});
  if (!fits || found->get<std::int64_t>() < lowest || found->get<std::int64_t>() > highest)
    return wrong(
        key,
        "must be an integer within " + std::to_string(lowest) + " and " + std::to_string(highest),
        lowest);
  return found->get<std::int64_t>();
}

std::string StrictObject::string(const char* key) {
  const nlohmann::json* found = find(key, true);
  if (found == nullptr) return "";
  if (!found->is_string()) return wrong(key, "must be a string", "");
  const auto& text = found->get_ref<const std::string&>();
  const bool printable =
      std::none_of(text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; });
  if (text.empty() || text.size() > 4096 || !printable)
    return wrong(key, "must be 1 to 4096 bytes without control characters", "");
  return text;
}

void StrictObject::numbers(const char* key, std::span<double> result, double lowest, double highest,
                           bool required) {
  const nlohmann::json* found = find(key, required);
  if (found == nullptr) return;
  if (!found->is_array() || found->size() != result.size()) {
    errors_.add(path(key), "must be an array of " + std::to_string(result.size()) + " numbers");
    return;
  }
  for (std::size_t i = 0; i < result.size(); ++i) {
    const nlohmann::json& element = (*found)[i];
    const double x = element.is_number() ? element.get<double>() : NAN;
    if (!std::isfinite(x) || x < lowest || x > highest) {
      errors_.add(path(key) + "/" + std::to_string(i),
                  "must be a number; it " + range_message(lowest, highest));
      return;
    }
    result[i] = x;
  }
}

const nlohmann::json* StrictObject::array(const char* key, std::size_t shortest,
                                          std::size_t longest) {
  const nlohmann::json* found = find(key, true);
  if (found == nullptr) return nullptr;
  if (!found->is_array() || found->size() < shortest || found->size() > longest) {
    const std::string sizes = std::to_string(shortest) + " to " + std::to_string(longest);
    return wrong(key, "must be an array of " + sizes + " elements", nullptr);
  }
  return found;
}

void StrictObject::finish() {
  if (!value_.is_object()) return;
  for (const auto& [key, unused] : value_.items()) {
    if (!known_.contains(key)) {
      errors_.add(path_, "unknown key " + json_text(key) +
                             did_you_mean(key, {known_.begin(), known_.end()}));
      return;
    }
  }
}

}  // namespace trocar
