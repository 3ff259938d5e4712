// SPDX-License-Identifier: Apache-2.0
#include "tests/stand_ins/force_dimension/settings.h"

#include <array>
#include <charconv>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

namespace stand_in {
namespace {

constexpr std::array<std::pair<std::string_view, FaultKind>, 13> kKinds{{
    {"silence", FaultKind::kSilence},
    {"late", FaultKind::kLate},
    {"error", FaultKind::kError},
    {"read_error", FaultKind::kReadError},
    {"nan", FaultKind::kNan},
    {"skew", FaultKind::kSkew},
    {"jump", FaultKind::kJump},
    {"frozen", FaultKind::kFrozen},
    {"same", FaultKind::kSame},
    {"disconnect", FaultKind::kDisconnect},
    {"no_device", FaultKind::kNoDevice},
    {"open_fails", FaultKind::kOpenFails},
    {"uncalibrated", FaultKind::kUncalibrated},
}};

std::string variable(const char* name) {
  const char* const value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe)
  return value == nullptr ? "" : value;
}

template <typename Number>
std::optional<Number> number(std::string_view text) {
  Number value{};
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || stop != text.data() + text.size()) return std::nullopt;
  return value;
}

/// Splits `text` at the first `mark`. The second part is empty if there is none.
std::pair<std::string_view, std::string_view> split(std::string_view text, char mark) {
  const std::size_t at = text.find(mark);
  if (at == std::string_view::npos) return {text, {}};
  return {text.substr(0, at), text.substr(at + 1)};
}

std::optional<Fault> parse_fault(std::string_view text) {
  const auto [what, when] = split(text, '@');
  const auto [name, code] = split(what, '=');
  const auto [start, duration] = split(when, ':');
  for (const auto& [known, kind] : kKinds) {
    if (name != known) continue;
    Fault fault{kind, 1, number<double>(start).value_or(-1), 0};
    const double forever = std::numeric_limits<double>::infinity();
    fault.end_s =
        fault.start_s + (duration.empty() ? forever : number<double>(duration).value_or(-1));
    if (!code.empty()) fault.code = number<int>(code).value_or(0);
    const bool good = fault.start_s >= 0 && fault.end_s > fault.start_s && fault.code > 0 &&
                      (code.empty() || kind == FaultKind::kError);
    if (good) return fault;
  }
  return std::nullopt;
}

Eigen::Vector3d vector_of(const nlohmann::json& entry, const char* key) {
  const auto v = entry.value(key, std::array<double, 3>{});
  return {v[0], v[1], v[2]};
}

std::vector<Keyframe> read_path(const std::string& file, std::string& error) {
  std::vector<Keyframe> path;
  try {
    std::ifstream stream(file);
    for (const nlohmann::json& entry : nlohmann::json::parse(stream)) {
      path.push_back({entry.at("t_s").get<double>(), vector_of(entry, "position_m"),
                      vector_of(entry, "rotation_vector_rad"),
                      entry.value("buttons", std::uint32_t{0})});
      if (path.size() > 1 && !(path.back().t_s > path[path.size() - 2].t_s)) {
        error = "TROCAR_DHD_PATH " + file + ": t_s does not ascend";
      }
    }
  } catch (const std::exception& exception) {
    error = "TROCAR_DHD_PATH " + file + ": " + exception.what();
  }
  return path;
}

std::vector<int> read_serials(std::string_view text, std::string& error) {
  std::vector<int> serials;
  while (!text.empty()) {
    const auto [one, rest] = split(text, ',');
    const std::optional<int> serial = number<int>(one);
    if (!serial) error = "TROCAR_DHD_SERIALS: " + std::string(one) + " is no number";
    serials.push_back(serial.value_or(0));
    text = rest;
  }
  return serials;
}

}  // namespace

std::string environment() {
  std::string all;
  for (const char* const name : {"TROCAR_DHD_MODEL", "TROCAR_DHD_PATH", "TROCAR_DHD_LOG",
                                 "TROCAR_DHD_FAULT", "TROCAR_DHD_SERIALS"}) {
    all += variable(name) + "\n";
  }
  return all;
}

std::vector<Fault> parse_faults(std::string_view text, std::string& error) {
  std::vector<Fault> faults;
  while (!text.empty()) {
    const auto [one, rest] = split(text, ',');
    const std::optional<Fault> fault = parse_fault(one);
    if (!fault) {
      error = "TROCAR_DHD_FAULT: " + std::string(one) + " is not KIND@SECONDS[:DURATION]";
      return {};
    }
    faults.push_back(*fault);
    text = rest;
  }
  return faults;
}

Settings read_settings() {
  Settings settings;
  if (const std::string model = variable("TROCAR_DHD_MODEL"); !model.empty()) {
    settings.model = model;
  }
  settings.has_active_wrist = settings.model == "sigma.7";
  settings.has_wrist = settings.has_active_wrist || settings.model == "omega.6";
  if (!settings.has_wrist && settings.model != "omega.3") {
    settings.error = "TROCAR_DHD_MODEL: " + settings.model + " is not omega.3, omega.6 or sigma.7";
  }
  if (const std::string path = variable("TROCAR_DHD_PATH"); !path.empty()) {
    settings.path = read_path(path, settings.error);
  }
  const std::string serials = variable("TROCAR_DHD_SERIALS");
  settings.serials = read_serials(serials.empty() ? "1" : serials, settings.error);
  settings.log = variable("TROCAR_DHD_LOG");
  settings.faults = parse_faults(variable("TROCAR_DHD_FAULT"), settings.error);
  return settings;
}

}  // namespace stand_in
