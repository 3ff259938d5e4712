// SPDX-License-Identifier: Apache-2.0
#include "tests/stand_ins/haply/command_message.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace trocar::haply_stand_in {
namespace {

using nlohmann::json;

/// The member of an object, or null if `value` is null, is no object, or has no such member.
const json* member(const json* value, const char* name) {
  if (!value || !value->is_object()) return nullptr;
  const auto found = value->find(name);
  return found == value->end() ? nullptr : &*found;
}

std::optional<double> number(const json* value) {
  if (!value || !value->is_number()) return std::nullopt;
  const double result = value->get<double>();
  return std::isfinite(result) ? std::optional(result) : std::nullopt;
}

std::optional<Vec3> vector(const json& value) {
  const auto x = number(member(&value, "x")), y = number(member(&value, "y"));
  const auto z = number(member(&value, "z"));
  if (!x || !y || !z) return std::nullopt;
  return Vec3{*x, *y, *z};
}

void read_force(const json& command, const Dialect& dialect, CommandMessage& message) {
  const bool is_old = dialect.protocol == Protocol::kV31;
  const json* force = member(&command, is_old ? "values" : "vector");
  const json* other = member(&command, is_old ? "vector" : "values");
  if (!force && dialect.accepts_both) force = other;
  if (!force) {
    (other ? message.is_misspelt : message.has_unusable_force) = true;
    return;
  }
  const auto value_N = vector(*force);
  if (!value_N) {
    message.has_unusable_force = true;
    return;
  }
  if (!message.force_N) message.force_N = Vec3{};
  for (std::size_t i = 0; i < 3; ++i) {
    (*message.force_N)[i] += (*value_N)[i];
    if (!std::isfinite((*message.force_N)[i])) message.has_unusable_force = true;
  }
}

void read_device(const json& device, const Dialect& dialect, CommandMessage& message) {
  const json* id = member(&device, "device_id");
  if (!id || !id->is_string() || id->get_ref<const std::string&>() != dialect.device_id) {
    message.names_other_device = true;
    return;
  }
  if (const json* force = member(member(&device, "commands"), "set_cursor_force"))
    read_force(*force, dialect, message);
  const json* configure = member(&device, "configure");
  const auto gain = number(member(member(configure, "force_gate"), "gain"));
  if (gain && is_gain(*gain)) message.force_gate_gain = gain;
  const json* preset = member(member(configure, "preset"), "preset");
  if (preset && preset->is_string()) message.preset = preset->get<std::string>().substr(0, 64);
}

void read_session(const json& session, CommandMessage& message) {
  const json* render = member(&session, "force_render_full_state");
  if (!render) return;
  const json* types = member(render, "device_types");
  if (!types || !types->is_array()) {
    message.wants_inverse3_config = message.wants_grip_config = true;
    return;
  }
  for (const json& type : *types) {
    if (!type.is_string()) continue;
    (type == "inverse3" ? message.wants_inverse3_config : message.wants_grip_config) = true;
  }
}

}  // namespace

CommandMessage parse_command(std::string_view text, const Dialect& dialect) {
  CommandMessage message;
  const json root = json::parse(text, nullptr, false);
  message.is_valid = root.is_object();
  if (!message.is_valid) {
    // JSON has no spelling for a number that is not finite, so a client that computed one sends a broken message.
    message.has_unusable_force = text.find("set_cursor_force") != std::string_view::npos;
    return message;
  }
  if (const json* session = member(&root, "session")) read_session(*session, message);
  const json* devices = member(&root, "inverse3");
  if (devices && devices->is_array())
    for (const json& device : *devices)
      read_device(device, dialect, message);
  if (message.has_unusable_force) message.force_N.reset();
  return message;
}

}  // namespace trocar::haply_stand_in
