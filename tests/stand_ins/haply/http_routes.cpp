// SPDX-License-Identifier: Apache-2.0
#include "tests/stand_ins/haply/http_routes.h"

#include <charconv>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

namespace trocar::haply_stand_in {
namespace {

using nlohmann::json;

HttpAnswer failed(unsigned status, const char* reason) {
  return {status, json{{"ok", false}, {"error", reason}}.dump()};
}

std::vector<std::string_view> split(std::string_view path) {
  std::vector<std::string_view> parts;
  while (!path.empty()) {
    path.remove_prefix(1);  // the slash
    const auto length = std::min(path.find('/'), path.size());
    parts.push_back(path.substr(0, length));
    path.remove_prefix(length);
  }
  return parts;
}

/// The sessions that `session=EXPRESSION` in a query names: a number with or without # (also as %23), or :INDEX, which
/// counts from the end if it is negative. All sessions without a query; none if there is no such session.
std::vector<int> sessions_of(std::string_view query, const std::map<int, double>& all) {
  std::vector<int> chosen;
  if (query.empty()) {
    for (const auto& entry : all)
      chosen.push_back(entry.first);
    return chosen;
  }
  constexpr std::string_view kName = "session=";
  if (!query.starts_with(kName)) return chosen;
  query.remove_prefix(kName.size());
  query = query.substr(0, query.find('&'));
  const bool is_index = query.starts_with(":");
  for (const std::string_view mark : {":", "%3A", "%3a", "#", "%23"})
    if (query.starts_with(mark)) query.remove_prefix(mark.size());
  int number = 0;
  const auto [end, error] = std::from_chars(query.data(), query.data() + query.size(), number);
  if (error != std::errc{} || end != query.data() + query.size()) return chosen;
  if (!is_index) {
    if (all.count(number) > 0) chosen.push_back(number);
    return chosen;
  }
  const int count = static_cast<int>(all.size());
  const int index = number < 0 && number >= -count ? count + number : number;
  if (index >= 0 && index < count) chosen.push_back(std::next(all.begin(), index)->first);
  return chosen;
}

HttpAnswer answer_force_gate(Service& service, std::string_view method, bool is_wildcard,
                             std::string_view query, std::string_view body) {
  auto& gates = service.force_gates();
  if (query.empty() && method != "DELETE") return failed(400, "session is required");
  const std::vector<int> sessions = sessions_of(query, gates);
  if (sessions.empty()) return failed(404, "no such session");
  double gain = service.default_force_gate();
  if (method == "GET") {
    if (is_wildcard) return failed(400, "the selector is ambiguous");
    gain = gates[sessions.front()];
  } else if (method == "POST") {
    const json root = json::parse(body, nullptr, false);
    if (!root.is_object() || !root.contains("gain") || !root["gain"].is_number() ||
        !is_gain(root["gain"].get<double>()))
      return failed(400, "gain must be a number from 0 to less than 1");
    gain = root["gain"].get<double>();
    for (const int session : sessions)
      gates[session] = gain;
  } else if (method == "DELETE") {
    for (const int session : sessions)
      gates[session] = gain;
  } else {
    return failed(405, "no such method");
  }
  return {200, json{{"ok", true}, {"data", {{"gain", gain}}}}.dump()};
}

}  // namespace

HttpAnswer answer_http(Service& service, std::string_view method, std::string_view target,
                       std::string_view body) {
  const auto mark = std::min(target.find('?'), target.size());
  const std::string_view path = target.substr(0, mark);
  const std::string_view query = target.substr(std::min(mark + 1, target.size()));
  const bool is_new = service.protocol() == Protocol::kV35;
  if (path == "/version" || path == "/devices") {
    if (method != "GET") return failed(405, "no such method");
    const json data = path == "/devices"
                          ? json::parse(service.inventory(), nullptr, false)
                          : json{{"project_name", "haply-inverse-service"},
                                 {"git_branch", "stand-in"},
                                 {"git_tag", is_new ? "3.5.0" : "3.1.0"},
                                 {"project_version", is_new ? "3.5.0.0" : "3.1.0.0"}};
    return {200, is_new ? json{{"ok", true}, {"data", data}}.dump() : data.dump()};
  }
  const auto parts = split(path);
  if (!is_new || parts.size() != 5 || parts[2] != "config" || parts[3] != "filters" ||
      parts[4] != "force_gate")
    return failed(404, "no such route");
  const bool is_wildcard = parts[0] == "*inverse" || parts[1] == "*";
  if (parts[0] != "inverse3" && parts[0] != "*inverse") return failed(404, "no such device");
  if (parts[1] != "*" && parts[1] != "0" && parts[1] != service.device_id())
    return failed(404, "no such device");
  return answer_force_gate(service, method, is_wildcard, query, body);
}

}  // namespace trocar::haply_stand_in
