// SPDX-License-Identifier: Apache-2.0
// The text of a state is put together by hand, because it is made a thousand times a second and its form never changes.
// Members are in alphabetical order, as those that were seen of the service.
#include "tests/stand_ins/haply/messages.h"

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

namespace stand_in {
namespace {

using nlohmann::json;

/// The member of an object, or null if `value` is null, is no object, or has no such member.
const json* member(const json* value, const char* name) {
  if (!value || !value->is_object()) return nullptr;
  const auto found = value->find(name);
  return found == value->end() ? nullptr : &*found;
}

void read_force(const json& command, Protocol protocol, CommandMessage& message) {
  const bool is_old = protocol == Protocol::kV31;
  const json* force = member(&command, is_old ? "values" : "vector");
  if (!force) {
    const bool has_other = member(&command, is_old ? "vector" : "values");
    (has_other ? message.is_misspelt : message.has_unusable_force) = true;
    return;
  }
  if (!message.force_N) message.force_N = Eigen::Vector3d::Zero();
  int at = 0;
  for (const char* name : {"x", "y", "z"}) {
    const json* number = member(force, name);
    (*message.force_N)[at++] += number && number->is_number() ? number->get<double>() : NAN;
  }
  if (!message.force_N->allFinite()) message.has_unusable_force = true;
}

void append_number(std::string& out, double value) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, static_cast<float>(value)).ptr;
  out.append(text, end);
}

void append_vector(std::string& out, const Eigen::Vector3d& v, std::string_view coordinate = {}) {
  for (int i = 0; i < 3; ++i) {
    out += i == 0 ? "{\"x\":" : i == 1 ? ",\"y\":" : ",\"z\":";
    if (coordinate.empty())
      append_number(out, v[i]);
    else
      out += coordinate;
  }
  out += '}';
}

void append_quaternion(std::string& out, const Eigen::Quaterniond& q) {
  out += "{\"w\":";
  append_number(out, q.w());
  out += ',';
  std::string vector;
  append_vector(vector, q.vec());
  out += vector.substr(1);
}

void append_string(std::string& out, std::string_view text) {
  out += '"';
  out += text;
  out += '"';
}

const char* text_of(bool value) {
  return value ? "true" : "false";
}

void append_arm_config(std::string& out, const StateMessage& message) {
  const bool is_old = message.protocol == Protocol::kV31;
  out += R"("config":{)";
  if (!is_old) out += R"("basis":{"permutation":"XYZ"},)";
  out += is_old ? R"("device_info":{"firmware_version":7,"hardware_version":4,"id":)"
                : R"("device_info":{"device_type":4,"id":)";
  append_string(out, message.device_id);
  out += is_old ? R"(,"model":4)" : R"(,"major_version":7,"minor_version":4)";
  out += R"(,"uuid":"00112233445566778899AABBCCDDEEFF"},)"
         R"("extended_device_id":"00112233445566778899AABBCCDDEEFF",)"
         R"("extended_firmware_version":"0123456789A",)";
  if (!is_old) {
    out += R"("filters":{"damping":{"scalar":0.0},"force_gate":{"gain":)";
    append_number(out, message.force_gate_gain);
    out += "}},";
  }
  out += R"("gravity_compensation":{"enabled":true,"scaling_factor":1.0},"handedness":"right")";
  if (!is_old) {
    out += R"(,"home_return":{"enabled":false},"mount":{"position":{"x":0,"y":0,"z":0},)"
           R"("rotation":{"w":1,"x":0,"y":0,"z":0},"scale":{"x":1,"y":1,"z":1}})";
  }
  out += R"(,"port":"/dev/ttyACM0")";
  if (!is_old) out += R"(,"preset":"defaults")";
  out += R"(,"streaming_mode":"USB","torque_scaling":{"enabled":true},"type":"inverse3"},)";
}

void append_arm_state(std::string& out, const StateMessage& message) {
  const Measured& measured = message.measured;
  out += R"("state":{"angular_position":{"a0":0.0,"a1":0.0,"a2":0.0},)"
         R"("angular_velocity":{"a0":0.0,"a1":0.0,"a2":0.0},)"
         R"("body_orientation":{"w":1.0,"x":0.0,"y":0.0,"z":0.0},)";
  const char* mode = measured.is_idle ? "\"idle\"" : "\"force\"";
  if (message.protocol == Protocol::kV35) {
    out += R"("control_domain":"cartesian","control_mode":)";
    out += mode;
    out += ',';
  }
  out += R"("current_angular_position":{"a0":0.0,"a1":0.0,"a2":0.0},)"
         R"("current_angular_torques":{"a0":0.0,"a1":0.0,"a2":0.0},"current_cursor_force":)";
  append_vector(out, measured.force_N);
  out += R"(,"current_cursor_position":{"x":0.0,"y":0.0,"z":0.0},"cursor_position":)";
  append_vector(out, measured.position_m, message.coordinate);
  out += R"(,"cursor_velocity":)";
  append_vector(out, measured.velocity_m_per_s);
  if (message.protocol == Protocol::kV31) {
    out += R"(,"mode":)";
    out += mode;
    out += R"(,"transform":{"position":{"x":0,"y":0,"z":0},)"
           R"("rotation":{"w":1,"x":0,"y":0,"z":0},"scale":{"x":1,"y":1,"z":1}}},)";
  } else {
    out += R"(,"transform":{}},)";  // all parts are the identity, so they are left out
  }
}

void append_arm(std::string& out, const StateMessage& message) {
  out += '{';
  if (message.has_config) append_arm_config(out, message);
  out += R"("device_id":)";
  append_string(out, message.device_id);
  out += ',';
  append_arm_state(out, message);
  out += R"("status":{"calibrated":true,"in_use":)";
  out += text_of(message.in_use);
  out += R"(,"power_supply":true,"ready":)";
  out += text_of(message.is_ready);
  out += R"(,"started":true}})";
}

void append_verse_grip(std::string& out, const StateMessage& message) {
  out += R"("verse_grip":[{)";
  if (message.has_config) out += R"("config":{"port":"/dev/ttyACM1","type":"verse_grip"},)";
  out += R"("device_id":"61548","state":{"button":)";
  out += text_of((message.measured.buttons & 1) != 0);
  out += R"(,"hall":0,"orientation":)";
  append_quaternion(out, message.measured.orientation);
  out += R"(},"status":{"error":0,"ready":true}}],)";
}

}  // namespace

CommandMessage parse_command(std::string_view text, Protocol protocol) {
  CommandMessage message;
  const json root = json::parse(text, nullptr, false);
  message.is_valid = root.is_object();
  if (!message.is_valid) {
    // JSON has no spelling for a number that is not finite, so a client that computed one sends a broken message.
    message.has_unusable_force = text.find("set_cursor_force") != std::string_view::npos;
    return message;
  }
  message.wants_config = member(member(&root, "session"), "force_render_full_state") != nullptr;
  const json* devices = member(&root, "inverse3");
  if (devices && devices->is_array()) {
    for (const json& device : *devices) {
      const json* id = member(&device, "device_id");
      if (!id || *id != kDeviceId) continue;
      if (const json* force = member(member(&device, "commands"), "set_cursor_force"))
        read_force(*force, protocol, message);
    }
  }
  if (message.has_unusable_force) message.force_N.reset();
  return message;
}

std::string text_of(const StateMessage& message) {
  std::string out;
  out.reserve(2048);
  out += '{';
  if (message.arms != ArmList::kMissing) {
    out += R"("inverse3":[)";
    if (message.arms == ArmList::kNormal) append_arm(out, message);
    out += "],";
  }
  if (message.session_id) out += "\"session_id\":" + std::to_string(*message.session_id) + ',';
  // An absent list is empty in version 3.1 and left out in version 3.5: a client must take both.
  if (message.has_grip)
    append_verse_grip(out, message);
  else if (message.protocol == Protocol::kV31)
    out += R"("verse_grip":[],)";
  if (out.back() == ',') out.pop_back();
  out += '}';
  return out;
}

}  // namespace stand_in
