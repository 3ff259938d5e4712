// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/pose/haply.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <charconv>
#include <exception>
#include <nlohmann/json.hpp>
#include <utility>  // before asio, which uses std::exchange without it

#include "formats/base/json.h"
#include "formats/base/text.h"
#include "runtime/realtime/realtime_thread.h"

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

namespace net = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using tcp = net::ip::tcp;
using beast::error_code;
using SteadyClock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr auto kInventoryPeriod = milliseconds(100);
constexpr auto kCloseTimeout = milliseconds(100);
constexpr int kMaxUnusable = 5;
/// Largest number of messages without a request that are dropped before the connection is given up.
constexpr int kMaxUnasked = 64;
/// Largest number of steps in which a message that has already arrived is read.
constexpr int kMaxPolls = 1000;

SteadyClock::duration seconds(double s) {
  return std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(s));
}

std::string words_of(error_code error) {
  if (error == net::error::timed_out) return "the service did not answer in time";
  if (error == websocket::error::closed) return "the service closed the connection";
  if (error == websocket::error::message_too_big || error == websocket::error::buffer_overflow)
    return "the service sent a message of more than 256 kB";
  if (error == boost::system::errc::protocol_error)
    return "the service floods the connection with messages that were not requested";
  if (error.category() == error_code(websocket::error::bad_opcode).category())
    return "the service sent something that is no WebSocket message";
  return "the connection to the service was lost (" + error.message() + "); is it still running?";
}

bool is_host_name(std::string_view text) {
  return !text.empty() && text.size() <= 253 && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '-' ||
           c == '_' || c == '.';
  });
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

/// The WebSocket. At any time at most one read and one other operation are pending.
struct HaplyConnection::Socket {
  struct Operation {
    bool is_pending = false;
    error_code error;
  };

  net::io_context context{1};
  websocket::stream<tcp::socket> stream{context};
  beast::flat_buffer buffer{kMaxHaplyMessageBytes};
  std::string sent;  ///< a write that did not end in time still refers to it
  Operation reading, other;
  bool is_open = false;  ///< messages can be sent

  /// Starts an operation by start(handler).
  template <typename Start>
  static void begin(Operation& operation, const Start& start) {
    operation.is_pending = true;
    start([&operation](error_code error, auto&&...) { operation = {false, error}; });
  }

  /// Returns the result of an operation, or timed_out while it is pending.
  error_code wait(const Operation& operation, SteadyClock::time_point until) {
    context.restart();
    while (operation.is_pending && context.run_one_until(until) > 0) {
    }
    // After a stall of this thread, the time can be over although the answer is there.
    for (int i = 0; i < kMaxPolls && operation.is_pending && context.poll_one() > 0; ++i) {
    }
    return operation.is_pending ? net::error::timed_out : operation.error;
  }

  template <typename Start>
  error_code run(SteadyClock::time_point until, const Start& start) {
    begin(other, start);
    return wait(other, until);
  }

  error_code send(std::string text, SteadyClock::time_point until) {
    sent = std::move(text);
    const error_code error =
        run(until, [&](auto done) { stream.async_write(net::buffer(sent), std::move(done)); });
    if (error) is_open = false;
    return error;
  }

  /// Waits for the next message. After timed_out, the message can still arrive later.
  error_code receive(std::string& text, SteadyClock::time_point until) {
    if (!reading.is_pending)
      begin(reading, [&](auto done) { stream.async_read(buffer, std::move(done)); });
    const error_code error = wait(reading, until);
    if (error) {
      if (error != net::error::timed_out) is_open = false;
      return error;
    }
    text.assign(static_cast<const char*>(buffer.data().data()), buffer.size());
    buffer.consume(buffer.size());
    return {};
  }

  /// Drops messages that were not requested. Otherwise states would wait in the buffers and grow old.
  error_code drop_unasked() {
    std::string text;
    for (int i = 0; i < kMaxUnasked; ++i) {
      const error_code error = receive(text, SteadyClock::time_point::min());
      if (error) return error == net::error::timed_out ? error_code{} : error;
    }
    return make_error_code(boost::system::errc::protocol_error);
  }
};

Result<HaplyAddress> parse_haply_address(std::string_view text) {
  HaplyAddress address;
  if (text.empty()) return address;
  const std::string quoted = "haply:" + std::string(text.substr(0, 256)) + ": ";
  const std::size_t colon = text.rfind(':');
  const std::string_view host = text.substr(0, colon);
  if (!is_host_name(host))
    return usage(quoted + "must be haply:HOST:PORT, haply:HOST or haply:, such as haply:localhost");
  const std::string port = colon == std::string_view::npos ? std::to_string(address.endpoint.port)
                                                           : std::string(text.substr(colon + 1));
  address.host = host;
  const Result<Endpoint> endpoint = parse_endpoint(address.host + ":" + port, 1);
  if (!endpoint) return usage(quoted + endpoint.error().message);
  address.endpoint = *endpoint;
  return address;
}

HaplyConnection::HaplyConnection(HaplyOptions options) : options_(std::move(options)) {
  uri_ = "haply:" + options_.address.host + ":" + std::to_string(options_.address.endpoint.port);
}

HaplyConnection::~HaplyConnection() {
  HaplyConnection::close();
}

Result<void> HaplyConnection::open() {
  close();
  try {
    // The first exchange is also a part of open().
    const Instant until =
        SteadyClock::now() + seconds(options_.open_timeout_s - kExchangeTimeout_s);
    if (auto connected = connect(until); !connected) return connected.error();
    const Result<HaplyDevices> found = find_devices(until);
    if (!found) return found.error();
    if (auto first = command(*found, {}); !first) return first.error();
    devices_ = *found;
    return {};
  } catch (const std::exception& thrown) {
    return fault(std::string("cannot be opened: ") + thrown.what());
  }
}

Result<void> HaplyConnection::connect(Instant until) {
  socket_ = std::make_unique<Socket>();
  auto& stream = socket_->stream;
  const Endpoint& peer = options_.address.endpoint;
  const tcp::endpoint endpoint(net::ip::address_v4(peer.address), peer.port);
  error_code error = socket_->run(
      until, [&](auto done) { stream.next_layer().async_connect(endpoint, std::move(done)); });
  if (error == net::error::connection_refused)
    return fault(
        "nothing listens there; start the Haply Inverse service (with Haply Hub, or by "
        "systemctl start haply-inverse-service), or give its address as haply:HOST:PORT");
  if (error == net::error::timed_out)
    return fault("there is no answer from this address; check it and the network");
  if (error) return fault("cannot be reached (" + error.message() + "); check the address");
  // Without this, the system may hold a message back until the previous one is acknowledged.
  stream.next_layer().set_option(tcp::no_delay(true), error);
  stream.read_message_max(kMaxHaplyMessageBytes);
  stream.auto_fragment(false);
  stream.text(true);
  const std::string host = options_.address.host + ":" + std::to_string(peer.port);
  error =
      socket_->run(until, [&](auto done) { stream.async_handshake(host, "/", std::move(done)); });
  if (error)
    return fault(
        "something listens there, but it does not answer like the Haply Inverse service; check the "
        "port, which is 10001 by default");
  socket_->is_open = true;
  return {};
}

Result<HaplyDevices> HaplyConnection::find_devices(Instant until) {
  std::string problem;  // of the latest inventory
  for (;;) {
    std::string text;
    if (const error_code error = socket_->receive(text, until)) {
      if (error != net::error::timed_out) return fault(words_of(error));
      return fault(problem.empty() ? "the service sends no inventory of devices; restart it"
                                   : problem);
    }
    const Result<HaplyInventory> inventory = parse_haply_inventory(text);
    if (!inventory)
      return fault(
          "the service does not speak version 3.1 or 3.5 of its protocol; update it, or check the "
          "port, which is 10001 by default (its message: " +
          inventory.error().message + ")");
    HaplyDevices chosen;
    const std::string found = choose(*inventory, chosen);
    if (found.empty()) {
      if (!devices_) describe(*inventory, chosen);
      return chosen;
    }
    if (found != problem) say(found + " (waiting for it)");
    problem = found;
    if (SteadyClock::now() + kInventoryPeriod >= until) return fault(problem);
    std::this_thread::sleep_for(kInventoryPeriod);
    if (const error_code error = socket_->send(haply_inventory_request(), until))
      return fault(words_of(error));
  }
}

std::string HaplyConnection::choose(const HaplyInventory& inventory, HaplyDevices& chosen) const {
  const auto& [arms, grips] = inventory;
  const auto arm = std::find_if(arms.begin(), arms.end(), [&](const HaplyArm& each) {
    return !devices_ || each.device == devices_->arm;
  });
  if (arm == arms.end())
    return devices_ ? "device " + devices_->arm.id + " is not connected any more; plug it in"
                    : "no Inverse3 is connected; plug it in and switch its power on";
  if (!arm->problem.empty()) return "device " + arm->device.id + " " + arm->problem;
  chosen.arm = arm->device;
  chosen.spelling = arm->spelling;

  const bool had_grip = devices_ && devices_->grip;
  if (devices_ && !had_grip) return "";
  auto grip = std::find_if(grips.begin(), grips.end(), [&](const HaplyGrip& each) {
    return had_grip ? each.device == devices_->grip : each.problem.empty();
  });
  if (grip != grips.end() && grip->problem.empty()) {
    chosen.grip = grip->device;
    return "";
  }
  if (!had_grip && !options_.wants_rotation) return "";
  if (!had_grip) grip = grips.begin();
  if (grip == grips.end())
    return "no VerseGrip is connected, which measures the orientation; connect it";
  return "VerseGrip " + grip->device.id + " " + grip->problem;
}

void HaplyConnection::describe(const HaplyInventory& inventory, const HaplyDevices& chosen) const {
  const std::string& id = chosen.arm.id;
  for (const HaplyArm& arm : inventory.arms) {
    if (!(arm.device == chosen.arm)) {
      say("device " + arm.device.id + " (" + arm.device.list +
          ") is connected too; it is not used");
      continue;
    }
    say("device " + id + " (" + arm.device.list +
        (arm.handedness.empty() ? "" : ", " + arm.handedness + "-handed") + ") was found, " +
        (chosen.grip ? "with VerseGrip " + chosen.grip->id
                     : "without a VerseGrip: no orientation is measured"));
    if (arm.handedness == "left")
      say("device " + id +
          " is set up for the left hand; a description of a right-handed device does not fit its "
          "workspace");
    if (!arm.has_default_frame)
      say("the service changes the coordinates of device " + id +
          " (its preset, basis, mount or transform is not the default); the description of the "
          "device must fit them");
    if (arm.force_gate_gain)
      say(
          text_line("the service's own filter force_gate, with gain %.3g, can change the force of "
                    "device %s, and is not passive; POST {\"gain\": ...} to "
                    "http://%s:%d/%s/%s/config/filters/force_gate?session=:-1 sets it",
                    *arm.force_gate_gain, id.c_str(), options_.address.host.c_str(),
                    int{options_.address.endpoint.port}, arm.device.list.c_str(), id.c_str()));
  }
  if (chosen.spelling == HaplySpelling::kBoth)
    say("the service does not show the version of its protocol; forces are sent in the forms of "
        "3.1 and 3.5");
}

Result<PoseReading> HaplyConnection::exchange(const HandleWrench& wrench) {
  if (!devices_ || !socket_ || !socket_->is_open) return fault("is not connected");
  const std::array<double, 3> force_N = {wrench[0], wrench[1], wrench[2]};
  for (const double component_N : force_N)
    if (!std::isfinite(component_N)) return fault("the commanded force is not finite");
  try {
    return command(*devices_, force_N);
  } catch (const std::exception& thrown) {
    return fault(std::string("exchange failed: ") + thrown.what());
  }
}

Result<PoseReading> HaplyConnection::command(const HaplyDevices& devices,
                                             const std::array<double, 3>& force_N) {
  const Instant until = SteadyClock::now() + seconds(kExchangeTimeout_s);
  const std::string message = haply_force_message(devices, force_N);
  std::string why;  // the latest answer was unusable
  refused_ = {};
  for (int unusable = 0; unusable < kMaxUnusable; ++unusable) {
    std::string text;
    error_code error = socket_->drop_unasked();
    if (!error) error = socket_->send(message, until);
    if (!error) error = socket_->receive(text, until);
    if (error) return fault(words_of(error) + (why.empty() ? "" : "; before that: " + why));
    const double t_s = 1e-9 * static_cast<double>(monotonic_ns());
    HaplyAnswer answer = parse_haply_answer(text, devices);
    answer.state.t_s = t_s;
    if (answer.kind != HaplyAnswer::Kind::kUnusable) refused_ = {};
    if (answer.kind == HaplyAnswer::Kind::kNotReady) return fault(answer.why);
    if (answer.kind == HaplyAnswer::Kind::kState) return answer.state;
    why = answer.why;
    refused_ = answer.refused;
  }
  return fault(std::to_string(kMaxUnusable) +
               " answers of the service in a row are unusable: " + why);
}

void HaplyConnection::close() noexcept {
  if (!socket_) return;
  try {
    Socket& socket = *socket_;
    const Instant until = SteadyClock::now() + kCloseTimeout;
    if (socket.is_open && devices_) {
      std::string answer;  // shows that the service has read the force
      if (!socket.send(haply_force_message(*devices_, {}), until))
        socket.receive(answer, until - kCloseTimeout / 2);
    }
    if (socket.is_open && !socket.reading.is_pending)
      socket.run(until, [&](auto done) {
        socket.stream.async_close(websocket::close_code::normal, std::move(done));
      });
  } catch (...) {
    // Without memory or sockets, the connection just ends, upon which the service stops the force.
  }
  socket_.reset();
}

}  // namespace trocar::runtime
