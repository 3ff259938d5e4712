// SPDX-License-Identifier: Apache-2.0
#include "runtime/connection/haply_messages.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "formats/base/strict_json.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

constexpr const char* kArmLists[] = {"inverse3", "inverse3x", "minverse"};
constexpr const char* kGripLists[] = {"verse_grip", "wireless_verse_grip"};
constexpr std::size_t kMaxDevices = 64;
constexpr std::size_t kMaxId = 64;
constexpr double kMaxCoordinate_m = 10;
constexpr double kMaxQuaternionError = 1e-3;

/// Reads values that may be missing, and keeps the first reason why the message is unusable.
class Reader {
 public:
  bool is_good() const { return wrong_.empty(); }
  const std::string& wrong() const { return wrong_; }
  void reject(std::string why) {
    if (wrong_.empty()) wrong_ = std::move(why);
  }

  /// Returns the object under a key; an empty one if there is none.
  const json& object(const json& parent, const char* key) {
    static const json kEmpty = json::object();
    const json* const found = find(parent, key);
    if (found == nullptr) return kEmpty;
    if (found->is_object()) return *found;
    reject(std::string("\"") + key + "\" is not an object");
    return kEmpty;
  }

  /// Returns `otherwise` if there is no such key.
  bool flag(const json& parent, const char* key, bool otherwise) {
    const json* const found = find(parent, key);
    if (found == nullptr) return otherwise;
    if (!found->is_boolean()) reject(std::string("\"") + key + "\" is not true or false");
    return found->is_boolean() ? found->get<bool>() : otherwise;
  }

  /// Returns a number that must be there.
  double number(const json& parent, const char* key) {
    const json* const found = find(parent, key);
    const double x = found != nullptr && found->is_number() ? found->get<double>() : NAN;
    if (!std::isfinite(x)) reject(std::string("\"") + key + "\" is not a number");
    return x;
  }

  /// Reads the devices of a list; read(id, device) for each.
  template <typename Read>
  void devices(const json& message, const char* list, const Read& read) {
    const json* const found = find(message, list);
    if (found == nullptr) return;
    if (!found->is_array() || found->size() > kMaxDevices)
      return reject(std::string("\"") + list + "\" is not a list of at most 64 devices");
    for (const json& device : *found) {
      const json* const id = device.is_object() ? find(device, "device_id") : nullptr;
      if (id == nullptr || !id->is_string() || !is_id(id->get_ref<const std::string&>()))
        return reject(std::string("\"") + list + "\" has a device without a valid id");
      read(id->get_ref<const std::string&>(), device);
    }
  }

 private:
  static const json* find(const json& parent, const char* key) {
    const auto found = parent.find(key);
    return found == parent.end() ? nullptr : &*found;
  }
  static bool is_id(const std::string& id) {
    return !id.empty() && id.size() <= kMaxId && std::all_of(id.begin(), id.end(), [](char c) {
      return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') ||
             std::strchr("-_.:", c) != nullptr;
    });
  }

  std::string wrong_;
};

/// Returns the message as a JSON object.
Result<json> parse_message(std::string_view text) {
  if (text.size() > kMaxHaplyMessageBytes) return refused("it is too long");
  Result<json> message = parse_strict_json(text, "message");
  // The parser's own reason would quote what the service sent.
  if (!message || !message->is_object()) return refused("it is no valid JSON object");
  return message;
}

/// Returns what keeps an arm from being used; empty: nothing.
std::string problem_of_arm(Reader& reader, const json& status) {
  if (!reader.flag(status, "power_supply", true))
    return "has no power; plug in its power supply and switch it on";
  if (!reader.flag(status, "ready", true)) return "is not ready; check its cable and its light";
  if (!reader.flag(status, "calibrated", true))
    return "is not calibrated; put the handle on its rest and wait until the light shows that it "
           "is calibrated";
  return "";
}

std::string problem_of_grip(Reader& reader, const json& status) {
  if (!reader.flag(status, "connected", true)) return "is not connected; switch it on";
  if (!reader.flag(status, "awake", true)) return "is asleep; move it or press a button";
  if (!reader.flag(status, "ready", true)) return "is not ready; switch it off and on";
  return "";
}

std::array<double, 3> vector_of(Reader& reader, const json& object) {
  return {reader.number(object, "x"), reader.number(object, "y"), reader.number(object, "z")};
}

/// Returns an orientation as w x y z.
std::array<double, 4> orientation_of(Reader& reader, const json& state, FaultDetail& refused) {
  const json& stated = reader.object(state, "orientation");
  const auto [x, y, z] = vector_of(reader, stated);
  const double w = reader.number(stated, "w");
  const double norm = std::sqrt(w * w + x * x + y * y + z * z);
  if (!(std::abs(norm - 1) <= kMaxQuaternionError)) {
    reader.reject("its orientation is no unit quaternion");
    if (!std::isnan(norm))  // no number is missing
      refused = {Fault::kRefusedState, FaultQuantity::kMeasuredRotation, -1, norm, 1};
  }
  return {w, x, y, z};
}

/// True if a transform is the identity. Parts of it that are identities may be left out.
bool is_identity(const json& transform) {
  const json identity = {{"position", {{"x", 0}, {"y", 0}, {"z", 0}}},
                         {"rotation", {{"w", 1}, {"x", 0}, {"y", 0}, {"z", 0}}},
                         {"scale", {{"x", 1}, {"y", 1}, {"z", 1}}}};
  for (const auto& [key, part] : identity.items()) {
    const auto found = transform.find(key);
    if (found != transform.end() && *found != part) return false;
  }
  return true;
}

bool has_default_frame(Reader& reader, const json& config, const json& state) {
  const json& basis = reader.object(config, "basis");
  const auto stated = [](const json& object, const char* key, const char* usual) {
    const auto found = object.find(key);
    return found == object.end() || *found == usual;
  };
  return stated(config, "preset", "defaults") && stated(basis, "permutation", "XYZ") &&
         is_identity(reader.object(config, "mount")) &&
         is_identity(reader.object(state, "transform"));
}

HaplyArm arm_of(Reader& reader, const char* list, const std::string& id, const json& device) {
  HaplyArm arm;
  arm.device = {list, id};
  const json& state = reader.object(device, "state");
  const json& config = reader.object(device, "config");
  if (state.contains("control_domain") || state.contains("control_mode"))
    arm.spelling = HaplySpelling::kVector;
  else if (state.contains("mode"))
    arm.spelling = HaplySpelling::kValues;
  for (const char* const hand : {"left", "right"})
    if (const auto stated = config.find("handedness"); stated != config.end() && *stated == hand)
      arm.handedness = hand;
  arm.has_default_frame = has_default_frame(reader, config, state);
  const json& gate = reader.object(reader.object(config, "filters"), "force_gate");
  if (gate.contains("gain")) arm.force_gate_gain = reader.number(gate, "gain");
  arm.problem = problem_of_arm(reader, reader.object(device, "status"));
  return arm;
}

std::uint32_t buttons_of(Reader& reader, const json& state) {
  std::uint32_t pressed = reader.flag(state, "button", false) ? 1 : 0;
  // The newest versions can give the buttons another form on request, which is not requested here.
  const auto buttons = state.find("buttons");
  if (buttons == state.end() || !buttons->is_object()) return pressed;
  constexpr std::pair<const char*, std::uint32_t> kButtons[] = {
      {"a", 1},        {"b", 2},        {"c", 4},        {"button_0", 1},
      {"button_1", 2}, {"button_2", 4}, {"button_3", 8},
  };
  for (const auto& [key, bit] : kButtons)
    if (reader.flag(*buttons, key, false)) pressed |= bit;
  return pressed;
}

void append(std::string& text, double x) {
  std::array<char, 32> digits{};
  const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), x);
  text.append(digits.data(), end);
}

}  // namespace

Result<HaplyInventory> parse_haply_inventory(std::string_view text) {
  const Result<json> message = parse_message(text);
  if (!message) return message.error();
  Reader reader;
  HaplyInventory inventory;
  bool is_known = message->empty() || message->contains("session_id");
  for (const char* const list : kArmLists) {
    is_known = is_known || message->contains(list);
    reader.devices(*message, list, [&](const std::string& id, const json& device) {
      inventory.arms.push_back(arm_of(reader, list, id, device));
    });
  }
  for (const char* const list : kGripLists) {
    is_known = is_known || message->contains(list);
    reader.devices(*message, list, [&](const std::string& id, const json& device) {
      HaplyGrip grip{{list, id}, problem_of_grip(reader, reader.object(device, "status"))};
      inventory.grips.push_back(std::move(grip));
    });
  }
  if (!is_known) reader.reject("it has no list of devices");
  if (!reader.is_good()) return refused(reader.wrong());
  return inventory;
}

HaplyAnswer parse_haply_answer(std::string_view text, const HaplyDevices& devices) {
  HaplyAnswer answer;
  const FaultDetail unreadable{Fault::kRefusedState, FaultQuantity::kRefusedContents, -1, 0, 0};
  const Result<json> message = parse_message(text);
  if (!message) {
    answer.why = message.error().message;
    answer.refused = unreadable;
    return answer;
  }
  Reader reader;
  std::string problem;  // why a device cannot be used any more
  bool has_arm = false, has_grip = false;
  reader.devices(*message, devices.arm.list.c_str(), [&](const std::string& id, const json& arm) {
    if (id != devices.arm.id || std::exchange(has_arm, true)) return;
    const std::string found = problem_of_arm(reader, reader.object(arm, "status"));
    if (!found.empty()) problem = "device " + id + " " + found;
    const json& position = reader.object(reader.object(arm, "state"), "cursor_position");
    answer.state.p_m = vector_of(reader, position);
    for (int i = 0; i < 3; ++i) {
      const double at_m = answer.state.p_m[static_cast<std::size_t>(i)];
      if (std::abs(at_m) <= kMaxCoordinate_m || answer.refused != Fault::kNone) continue;
      reader.reject("its position is beyond 10 m");
      if (!std::isnan(at_m))  // it is not missing
        answer.refused = {Fault::kRefusedState, FaultQuantity::kMeasuredPosition, i, at_m,
                          std::copysign(kMaxCoordinate_m, at_m)};
    }
  });
  if (devices.grip) {
    reader.devices(*message, devices.grip->list.c_str(), [&](const std::string& id, const json& g) {
      if (id != devices.grip->id || std::exchange(has_grip, true)) return;
      const std::string found = problem_of_grip(reader, reader.object(g, "status"));
      if (!found.empty() && problem.empty()) problem = "VerseGrip " + id + " " + found;
      const json& state = reader.object(g, "state");
      FaultDetail refused;
      answer.state.q = orientation_of(reader, state, refused);
      if (answer.refused == Fault::kNone) answer.refused = refused;
      answer.state.buttons = buttons_of(reader, state);
    });
  }
  if (!reader.is_good() && answer.refused == Fault::kNone) answer.refused = unreadable;
  if (!has_arm) reader.reject("it does not list device " + devices.arm.id);
  if (devices.grip && !has_grip) reader.reject("it does not list VerseGrip " + devices.grip->id);
  answer.kind = !problem.empty()   ? HaplyAnswer::Kind::kNotReady
                : reader.is_good() ? HaplyAnswer::Kind::kState
                                   : HaplyAnswer::Kind::kUnusable;
  answer.why = problem.empty() ? reader.wrong() : problem;
  if (answer.kind != HaplyAnswer::Kind::kUnusable) answer.refused = {};
  return answer;
}

std::string haply_force_message(const HaplyDevices& devices, const std::array<double, 3>& force_N) {
  std::string vector = "{\"x\":";
  append(vector, force_N[0]);
  vector += ",\"y\":";
  append(vector, force_N[1]);
  vector += ",\"z\":";
  append(vector, force_N[2]);
  vector += "}";
  std::string text = "{\"" + devices.arm.list + "\":[{\"device_id\":\"" + devices.arm.id +
                     "\",\"commands\":{\"set_cursor_force\":{";
  if (devices.spelling != HaplySpelling::kVector) text += "\"values\":" + vector;
  if (devices.spelling == HaplySpelling::kBoth) text += ",";
  if (devices.spelling != HaplySpelling::kValues) text += "\"vector\":" + vector;
  return text + "}}}]}";
}

std::string haply_inventory_request() {
  return R"({"session":{"force_render_full_state":{}}})";
}

}  // namespace trocar::runtime
