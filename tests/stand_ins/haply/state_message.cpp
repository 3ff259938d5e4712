// SPDX-License-Identifier: Apache-2.0
// The text is put together by hand, because it is made a thousand times a second and its form never changes. Members are
// in alphabetical order, as those that were seen of the service.
#include "tests/stand_ins/haply/state_message.h"

#include <charconv>

namespace trocar::haply_stand_in {
namespace {

void append_number(std::string& out, double value) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, static_cast<float>(value)).ptr;
  out.append(text, end);
}

void append_vector(std::string& out, const Vec3& v, std::string_view coordinate = {}) {
  for (std::size_t i = 0; i < 3; ++i) {
    out += i == 0 ? "{\"x\":" : i == 1 ? ",\"y\":" : ",\"z\":";
    if (coordinate.empty())
      append_number(out, v[i]);
    else
      out += coordinate;
  }
  out += '}';
}

void append_quaternion(std::string& out, const Quaternion& q) {
  constexpr const char* kNames[] = {"{\"w\":", ",\"x\":", ",\"y\":", ",\"z\":"};
  for (std::size_t i = 0; i < 4; ++i) {
    out += kNames[i];
    append_number(out, q[i]);
  }
  out += '}';
}

void append_string(std::string& out, std::string_view text) {
  out += '"';
  for (const char c : text)  // a preset comes from a client
    if (c >= ' ' && c <= '~' && c != '"' && c != '\\') out += c;
  out += '"';
}

const char* text_of(bool value) {
  return value ? "true" : "false";
}

void append_arm_config(std::string& out, const StateMessage& message, std::string_view id) {
  const bool is_old = message.protocol == Protocol::kV31;
  out += R"("config":{)";
  if (!is_old) out += R"("basis":{"permutation":"XYZ"},)";
  out += is_old ? R"("device_info":{"firmware_version":7,"hardware_version":4,"id":)"
                : R"("device_info":{"device_type":4,"id":)";
  append_string(out, id);
  out += is_old ? R"(,"model":4)" : R"(,"major_version":7,"minor_version":4)";
  out += R"(,"uuid":"00112233445566778899AABBCCDDEEFF"},)"
         R"("extended_device_id":"00112233445566778899AABBCCDDEEFF",)"
         R"("extended_firmware_version":"0123456789A",)";
  if (!is_old) {
    out += R"("filters":{"damping":{"scalar":0.0},"force_gate":{"gain":)";
    append_number(out, message.force_gate_gain);
    out += "}},";
  }
  out += R"("gravity_compensation":{"enabled":true,"scaling_factor":1.0},"handedness":)";
  append_string(out, message.handedness);
  if (!is_old) {
    out += R"(,"home_return":{"enabled":false},"mount":{"position":{"x":0,"y":0,"z":0},)"
           R"("rotation":{"w":1,"x":0,"y":0,"z":0},"scale":{"x":1,"y":1,"z":1}})";
  }
  out += R"(,"port":"/dev/ttyACM0")";
  if (!is_old) {
    out += R"(,"preset":)";
    append_string(out, message.preset);
  }
  out += R"(,"streaming_mode":"USB","torque_scaling":{"enabled":true},"type":"inverse3"},)";
}

void append_arm_state(std::string& out, const StateMessage& message, const Measured& measured,
                      std::string_view coordinate) {
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
  append_vector(out, measured.position_m, coordinate);
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

void append_arm(std::string& out, const StateMessage& message, std::string_view id,
                const Measured& measured, std::string_view coordinate) {
  out += '{';
  if (message.has_inverse3_config) append_arm_config(out, message, id);
  out += R"("device_id":)";
  append_string(out, id);
  out += ',';
  if (message.arms != ArmList::kNoState) append_arm_state(out, message, measured, coordinate);
  out += R"("status":{"calibrated":true,"in_use":)";
  out += text_of(message.in_use);
  out += R"(,"power_supply":true,"ready":)";
  out += text_of(message.is_ready);
  out += R"(,"started":true}})";
}

void append_arms(std::string& out, const StateMessage& message) {
  if (message.arms == ArmList::kMissing) return;
  out += R"("inverse3":[)";
  const bool has_first = message.arms == ArmList::kNormal || message.arms == ArmList::kNoState;
  if (has_first) append_arm(out, message, message.device_id, message.measured, message.coordinate);
  if (message.arms == ArmList::kOnlySecond || (has_first && message.has_second_device)) {
    if (has_first) out += ',';
    Measured second;
    second.position_m = {0.2, -0.12, 0.15};
    append_arm(out, message, kSecondDevice, second, {});
  }
  out += "],";
}

void append_verse_grip(std::string& out, const StateMessage& message) {
  out += R"("verse_grip":[{)";
  if (message.has_grip_config) out += R"("config":{"port":"/dev/ttyACM1","type":"verse_grip"},)";
  out += R"("device_id":"61548","state":{"button":)";
  out += text_of((message.measured.buttons & 1) != 0);
  out += R"(,"hall":0,"orientation":)";
  append_quaternion(out, message.measured.orientation);
  out += R"(},"status":{"error":0,"ready":true}}],)";
}

void append_wireless_grip(std::string& out, const StateMessage& message) {
  constexpr const char* kLetters[] = {R"("a":)", R"("b":)", R"("c":)"};
  constexpr const char* kNumbers[] = {R"("button_0":)", R"("button_1":)", R"("button_2":)",
                                      R"("button_3":)"};
  out += R"("wireless_verse_grip":[{)";
  if (message.has_grip_config) out += R"("config":{"type":"wireless_verse_grip"},)";
  out += R"("device_id":"C0FFEE","state":{"battery_level":0.75,"buttons":{)";
  for (unsigned i = 0; i < (message.numbers_buttons ? 4u : 3u); ++i) {
    if (i > 0) out += ',';
    out += message.numbers_buttons ? kNumbers[i] : kLetters[i];
    out += text_of((message.measured.buttons >> i & 1) != 0);
  }
  out += R"(},"hall":0,"orientation":)";
  append_quaternion(out, message.measured.orientation);
  out += R"(},"status":{"awake":true,"connected":true,"ready":true}}],)";
}

}  // namespace

std::string text_of(const StateMessage& message) {
  std::string out;
  out.reserve(2048);
  out += '{';
  append_arms(out, message);
  if (message.session_id) out += "\"session_id\":" + std::to_string(*message.session_id) + ',';
  if (message.grip == Grip::kVerseGrip) append_verse_grip(out, message);
  if (message.grip == Grip::kWireless) append_wireless_grip(out, message);
  // An absent list is empty in version 3.1 and left out in version 3.5: a client must take both.
  if (message.grip == Grip::kNone && message.protocol == Protocol::kV31)
    out += R"("verse_grip":[],)";
  if (out.back() == ',') out.pop_back();
  out += '}';
  return out;
}

}  // namespace trocar::haply_stand_in
