// SPDX-License-Identifier: Apache-2.0
// The only file that includes Boost.Beast: it takes long to compile.
#include "runtime/console/server.h"

#include <csignal>
#include <utility>  // before asio, which uses std::exchange without it

#include <boost/asio.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <deque>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string_view>
#include <vector>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/base/strict_json.h"
#include "formats/session/scene.h"
#include "runtime/console/access.h"
#include "runtime/console/bone.h"
#include "runtime/console/rows.h"

namespace trocar::runtime {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = net::ip::tcp;
using nlohmann::json;
using Clock = std::chrono::steady_clock;
using Request = http::request<http::string_body>;
using Response = http::response<http::string_body>;

constexpr std::size_t kMostConnections = 64, kMostPages = 16;
constexpr std::uint32_t kMostHeader = 8 << 10;
constexpr std::uint64_t kMostBody = 4 << 10, kMostMessage = 4 << 10;
constexpr std::size_t kMostOutstanding = 4, kMostSnapshotsOutstanding = 2, kEventsOfMessage = 64;
// A page gets a snapshot when it has just been read, so that it is young.
constexpr auto kPollEvery = std::chrono::milliseconds(2), kPollIdle = std::chrono::milliseconds(25);
constexpr auto kSnapshotEvery = std::chrono::milliseconds(15);
constexpr auto kSnapshotAnyway = std::chrono::milliseconds(50);  // the last one of a session
constexpr auto kStalled = std::chrono::seconds(6);
constexpr auto kFirstMessageWithin = std::chrono::seconds(5);
constexpr auto kRequestWithin = std::chrono::seconds(20);
constexpr auto kDrainWithin = std::chrono::seconds(1);
constexpr int kMostDrained = 64;
constexpr auto kEndWithin = std::chrono::seconds(10);
constexpr int kSendBuffer = 65536;
constexpr const char* kNoStore = "no-store";
constexpr const char* kPolicyOfData = "default-src 'none'; frame-ancestors 'none'";
constexpr const char* kPolicyOfReport =
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox; frame-ancestors 'none'";

/// One line for each kind of refusal, however often it comes.
class Log {
 public:
  void refused(const char* kind, const std::string& from) {
    if (told_.insert(kind).second)
      std::fprintf(stderr, "trocar-console: refused: %s, from %s (more of this are not told)\n",
                   kind, from.c_str());
  }
  void emergency_stop(const std::string& from) {
    const auto now = Clock::now();
    if (last_stop_ && now - *last_stop_ < std::chrono::seconds(10)) return;
    last_stop_ = now;
    std::fprintf(stderr, "trocar-console: emergency stop, asked for from %s\n", from.c_str());
  }

 private:
  std::set<std::string> told_;
  std::optional<Clock::time_point> last_stop_;
};

struct Answer {
  http::status status = http::status::ok;
  std::string type = "application/json", body;
  const char* policy = kPolicyOfData;
};

Answer failure(http::status status, const std::string& message) {
  return {status, "application/json", json_text({{"ok", false}, {"error", message}}),
          kPolicyOfData};
}
Answer done() {
  return {http::status::ok, "application/json", R"({"ok":true})", kPolicyOfData};
}

class HttpConnection;
class LivePage;

struct Console {
  Console(net::io_context& io, const ServerSettings& its_settings, Files its_files,
          PageFiles its_page, HostNames its_hosts)
      : context(io),
        settings(its_settings),
        files(std::move(its_files)),
        page(std::move(its_page)),
        hosts(std::move(its_hosts)),
        supervisor(its_settings.session) {}

  net::io_context& context;
  const ServerSettings& settings;
  Files files;
  PageFiles page;
  HostNames hosts;
  Tokens tokens;
  Supervisor supervisor;
  Log log;
  std::vector<std::weak_ptr<HttpConnection>> connections;
  std::vector<std::weak_ptr<LivePage>> pages;
  std::function<void()> poll_soon;
  bool has_new_snapshot = false;  ///< by the last poll
  // Of the worker thread: reading files of any size must not delay what is live.
  net::thread_pool worker{1};
  std::string bone_key;
  std::shared_ptr<const std::string> bone;
};

template <typename T>
std::size_t count_living(std::vector<std::weak_ptr<T>>& all) {
  std::erase_if(all, [](const auto& one) { return one.expired(); });
  return all.size();
}

std::string_view view_of(beast::string_view text) {
  return {text.data(), text.size()};
}

/// The path and the parameters of a request's target; nothing if it is malformed.
struct Target {
  std::string path;
  std::map<std::string, std::string> parameters;
  static std::optional<Target> parse(std::string_view text);
  std::string parameter(const char* name) const {
    const auto found = parameters.find(name);
    return found == parameters.end() ? "" : found->second;
  }
};

int digit_of(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

std::optional<std::string> decoded(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i];
      continue;
    }
    const int high = i + 2 < text.size() ? digit_of(text[i + 1]) : -1;
    const int low = i + 2 < text.size() ? digit_of(text[i + 2]) : -1;
    if (high < 0 || low < 0) return std::nullopt;
    out += static_cast<char>(16 * high + low);
    i += 2;
  }
  return out;
}

std::optional<Target> Target::parse(std::string_view text) {
  constexpr std::size_t kMostParameters = 8;
  Target target;
  const std::size_t question = text.find('?');
  const auto path = decoded(text.substr(0, question));
  if (!path || !path->starts_with('/')) return std::nullopt;
  target.path = *path;
  std::string_view rest = question == std::string_view::npos ? "" : text.substr(question + 1);
  while (!rest.empty()) {
    const std::string_view one = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(rest.size(), one.size() + 1));
    const std::size_t equals = one.find('=');
    if (equals == std::string_view::npos || target.parameters.size() == kMostParameters)
      return std::nullopt;
    const auto name = decoded(one.substr(0, equals)), value = decoded(one.substr(equals + 1));
    if (!name || !value || !target.parameters.emplace(*name, *value).second) return std::nullopt;
  }
  return target;
}

std::string text_of(const tcp::endpoint& endpoint) {
  return endpoint.address().to_string() + ":" + std::to_string(endpoint.port());
}

/// A page that watches, or a script. What it has not got yet is found anew for each message from
/// the supervisor, so nothing is queued for a page that does not read.
class LivePage : public std::enable_shared_from_this<LivePage> {
 public:
  LivePage(Console& console, beast::tcp_stream stream, std::string from)
      : console_(console), socket_(std::move(stream)), from_(std::move(from)) {}

  void run(const Request& request) {
    beast::error_code ignored;
    socket_.next_layer().socket().set_option(net::socket_base::send_buffer_size(kSendBuffer),
                                             ignored);
    socket_.next_layer().expires_never();
    websocket::stream_base::timeout timeout{};
    timeout.handshake_timeout = kFirstMessageWithin;
    timeout.idle_timeout = kStalled;
    timeout.keep_alive_pings = true;
    socket_.set_option(timeout);
    websocket::permessage_deflate deflate;
    deflate.server_enable = false;
    socket_.set_option(deflate);
    socket_.read_message_max(kMostMessage);
    socket_.auto_fragment(false);
    opened_at_ = Clock::now();
    socket_.async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (!error) self->read();
    });
  }

  /// Sends what is next, if it may.
  void pump(Clock::time_point now) {
    if (role_ == Role::kNone) {
      if (now - opened_at_ > kFirstMessageWithin) abort();
      return;
    }
    if (!outstanding_.empty() && now - outstanding_.front().sent_at > kStalled) {
      abort();
      return;
    }
    if (is_writing_ || is_closing_) return;
    const Supervisor& session = console_.supervisor;
    if (!said_hello_ || session_ != session.sessions()) return say_hello();
    // Events first: whoever reads "ended" has got all of them.
    if (cursor_ < session.last_event()) {
      send_events();
      if (is_writing_) return;
    }
    if (state_ != session.state_version()) {
      state_ = session.state_version();
      return send_text(session.state_json());
    }
    if (outstanding_.size() >= kMostOutstanding) return;
    const auto snapshots_out = static_cast<std::size_t>(
        std::count_if(outstanding_.begin(), outstanding_.end(),
                      [](const Outstanding& one) { return one.kind == kSnapshot; }));
    if (snapshot_ != session.snapshots() &&
        (console_.has_new_snapshot || snapshot_ == 0 || now - snapshot_at_ >= kSnapshotAnyway) &&
        snapshots_out < kMostSnapshotsOutstanding && now - snapshot_at_ >= kSnapshotEvery) {
      if (Frame frame = console_.supervisor.snapshot()) {
        snapshot_ = session.snapshots();
        snapshot_at_ = now;
        return send_frame(kSnapshot, std::move(frame), now);
      }
    }
    const auto& sheets = session.sheets();
    for (std::size_t i = 0; i < sheets.size(); ++i) {
      if (sheet_versions_[i] == sheets[i].version) continue;
      sheet_versions_[i] = sheets[i].version;
      if (sheets[i].frame) return send_frame(kSheet, sheets[i].frame, now);
    }
    if (shape_version_ != session.shape().version && session.shape().frame) {
      shape_version_ = session.shape().version;
      send_frame(kShape, session.shape().frame, now);
    }
  }

  void abort() {
    beast::error_code ignored;
    is_closing_ = true;
    beast::get_lowest_layer(socket_).socket().close(ignored);
  }

 private:
  static constexpr std::uint32_t kSnapshot = 1, kSheet = 2, kShape = 3;
  struct Outstanding {
    std::uint32_t number = 0, kind = 0;
    Clock::time_point sent_at;
  };

  void read() {
    socket_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return self->on_error(error);
      self->on_message();
    });
  }

  void on_error(beast::error_code error) {
    is_closing_ = true;
    if (error == websocket::error::message_too_big || error == websocket::error::buffer_overflow)
      console_.log.refused("a WebSocket message that is too long", from_);
    else if (error.category() == beast::error_code(websocket::error::bad_opcode).category() &&
             error != websocket::error::closed)
      console_.log.refused("a malformed WebSocket frame", from_);
  }

  void on_message() {
    const bool is_text = socket_.got_text();
    const std::string text = beast::buffers_to_string(buffer_.data());
    buffer_.consume(buffer_.size());
    if (is_closing_) return;
    const Result<json> message =
        is_text ? parse_strict_json(text, "message") : Result<json>(refused("not text"));
    const bool is_good = message && message->is_object() &&
                         (role_ == Role::kNone ? on_first(*message) : on_ack(*message));
    if (!is_good) {
      console_.log.refused(role_ == Role::kNone
                               ? "a WebSocket without a right token in its first message"
                               : "a malformed WebSocket message",
                           from_);
      return close();
    }
    read();
    pump(Clock::now());
  }

  bool on_first(const json& message) {
    JsonErrors errors{"message", {}};
    StrictObject object(message, "", errors);
    const std::string token = object.string("token");
    std::string session;
    if (object.has("session")) session = object.string("session");
    constexpr std::int64_t kMost = std::int64_t{1} << 53;
    const std::int64_t last = object.integer("last_event", 0, kMost, 0);
    object.finish();
    if (errors.first) return false;
    role_ = console_.tokens.role_of(token);
    if (session == console_.supervisor.id()) first_cursor_ = static_cast<std::uint64_t>(last);
    return role_ != Role::kNone;
  }

  bool on_ack(const json& message) {
    const auto ack = message.find("ack");
    if (message.size() != 1 || ack == message.end() || !ack->is_number_unsigned()) return false;
    const auto number = ack->get<std::uint64_t>();
    while (!outstanding_.empty() && outstanding_.front().number <= number)
      outstanding_.pop_front();
    return true;
  }

  void close() {
    is_closing_ = true;
    if (is_writing_) return abort();
    socket_.async_close(websocket::close_code::policy_error,
                        [self = shared_from_this()](beast::error_code) {});
  }

  void say_hello() {
    const Supervisor& session = console_.supervisor;
    cursor_ = said_hello_ ? 0 : first_cursor_;
    said_hello_ = true;
    session_ = session.sessions();
    state_ = 0;
    snapshot_ = 0;
    shape_version_ = 0;
    sheet_versions_.assign(session.sheets().size(), 0);
    if (session.about().empty())
      return send_text(R"({"hello":null,"session":"","columns":[],"last_event":0,"role":")" +
                       std::string(to_string(role_)) + "\"}");
    send_text("{\"hello\":" + session.about() + ",\"session\":" + json_text(session.id()) +
              ",\"role\":\"" + to_string(role_) + "\",\"columns\":" + session.columns() +
              ",\"last_event\":" + std::to_string(session.last_event()) + "}");
  }

  void send_events() {
    const auto& events = console_.supervisor.events();
    auto event = std::upper_bound(
        events.begin(), events.end(), cursor_,
        [](std::uint64_t number, const Supervisor::Event& one) { return number < one.number; });
    if (event == events.end()) return;
    if (event->number != cursor_ + 1) {
      const std::uint64_t missed = event->number - cursor_ - 1;
      cursor_ = event->number - 1;
      return send_text("{\"missed\":" + std::to_string(missed) + "}");
    }
    std::string text = "{\"events\":[";
    for (std::size_t i = 0;
         i < kEventsOfMessage && event != events.end() && event->number == cursor_ + 1;
         ++i, ++event) {
      text += (i == 0 ? "" : ",") + event->json;
      cursor_ = event->number;
    }
    send_text(text + "]}");
  }

  void send_text(std::string text) {
    text_ = std::move(text);
    socket_.text(true);
    is_writing_ = true;
    socket_.async_write(net::buffer(text_), written());
  }

  void send_frame(std::uint32_t kind, Frame frame, Clock::time_point now) {
    frame_ = std::move(frame);
    head_ = {kind, ++number_};
    outstanding_.push_back({number_, kind, now});
    socket_.binary(true);
    is_writing_ = true;
    socket_.async_write(std::array<net::const_buffer, 2>{net::buffer(head_), net::buffer(*frame_)},
                        written());
  }

  std::function<void(beast::error_code, std::size_t)> written() {
    return [self = shared_from_this()](beast::error_code error, std::size_t) {
      self->is_writing_ = false;
      if (!error) self->pump(Clock::now());
    };
  }

  Console& console_;
  websocket::stream<beast::tcp_stream> socket_;
  std::string from_;
  beast::flat_buffer buffer_;
  Role role_ = Role::kNone;
  bool said_hello_ = false, is_writing_ = false, is_closing_ = false;
  Clock::time_point opened_at_, snapshot_at_;
  std::string text_;
  std::array<std::uint32_t, 2> head_{};
  Frame frame_;
  std::uint32_t number_ = 0;
  std::deque<Outstanding> outstanding_;
  std::uint64_t session_ = 0, state_ = 0, cursor_ = 0, first_cursor_ = 0, snapshot_ = 0;
  std::vector<std::uint64_t> sheet_versions_;
  std::uint64_t shape_version_ = 0;
};

/// Requests of one connection, one after the other.
class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(Console& console, tcp::socket socket, std::string from)
      : console_(console), stream_(std::move(socket)), from_(std::move(from)) {}

  void read() {
    is_idle_ = true;
    parser_.emplace();
    parser_->header_limit(kMostHeader);
    parser_->body_limit(kMostBody);
    stream_.expires_after(kRequestWithin);
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](beast::error_code error, std::size_t) {
                       self->is_idle_ = false;
                       if (error) return self->on_error(error);
                       self->answer(self->parser_->release());
                     });
  }
  bool is_idle() const noexcept { return is_idle_; }
  void close() {
    beast::error_code ignored;
    stream_.socket().close(ignored);
  }

 private:
  void on_error(beast::error_code error) {
    if (error == http::error::body_limit)
      return refuse(http::status::payload_too_large, "a request whose body is too long");
    if (error == http::error::header_limit || error == http::error::buffer_overflow)
      return refuse(http::status::request_header_fields_too_large,
                    "a request whose header is too long");
    if (error.category() == beast::error_code(http::error::bad_method).category() &&
        error != http::error::end_of_stream && error != http::error::partial_message)
      return refuse(http::status::bad_request, "a malformed request");
    close();
  }

  /// Logs it, answers, and closes the connection.
  void refuse(http::status status, const char* kind) {
    console_.log.refused(kind, from_);
    keep_ = false;
    send(failure(status, std::string("refused: ") + kind));
  }

  void answer(Request request) {
    version_ = request.version();
    keep_ = request.keep_alive();
    const std::string_view host = view_of(request[http::field::host]);
    if (request.count(http::field::host) != 1 || !console_.hosts.is_host(host))
      return refuse(http::status::misdirected_request, "a request for a foreign Host");
    if (request.count(http::field::origin) > 0 &&
        (request.count(http::field::origin) != 1 ||
         !HostNames::is_origin(view_of(request[http::field::origin]), host)))
      return refuse(http::status::forbidden, "a request with a foreign Origin");
    const auto target = Target::parse(view_of(request.target()));
    if (!target) return refuse(http::status::bad_request, "a malformed request");
    const bool is_get = request.method() == http::verb::get;
    if (target->path == "/live") {
      if (!websocket::is_upgrade(request))
        return send(failure(http::status::upgrade_required, "/live is a WebSocket"));
      return open_page(request);
    }
    if (!target->path.starts_with("/api/")) {
      const PageFile* const file = console_.page.find(target->path);
      if (file == nullptr) return send(failure(http::status::not_found, "there is no such page"));
      if (!is_get) return not_allowed();
      return send(
          {http::status::ok, file->type, file->bytes, console_.page.security_policy().c_str()});
    }
    if (target->path == "/api/emergency_stop") {
      if (request.method() != http::verb::post) return not_allowed();
      console_.log.emergency_stop(from_);
      return send(result_of(console_.supervisor.emergency_stop()));
    }
    const Role role =
        request.count(http::field::authorization) == 1
            ? console_.tokens.role_of_header(view_of(request[http::field::authorization]))
            : Role::kNone;
    if (role == Role::kNone)
      return refuse(http::status::unauthorized, "a request without a right token");
    if (target->path == "/api/start" || target->path == "/api/command") {
      if (request.method() != http::verb::post) return not_allowed();
      if (role != Role::kOperator) {
        console_.log.refused("a command from an audience", from_);
        return send(failure(http::status::forbidden, "an audience may look, not command"));
      }
      const Result<json> body = parse_strict_json(request.body(), "body");
      if (!body) return send(failure(http::status::bad_request, body.error().message));
      if (!body->is_object())
        return send(failure(http::status::bad_request, "body: must be an object"));
      return send(target->path == "/api/start" ? start(*body) : command(*body));
    }
    if (!is_get) return not_allowed();
    get(*target, role);
  }

  void not_allowed() {
    send(failure(http::status::method_not_allowed, "another method is needed here"));
  }

  Answer result_of(const Result<void>& result) {
    if (console_.poll_soon) console_.poll_soon();
    return result ? done() : failure(http::status::conflict, result.error().message);
  }

  Answer command(const json& body) {
    JsonErrors errors{"body", {}};
    StrictObject object(body, "", errors);
    const std::string name = object.string("command");
    object.finish();
    if (errors.first) return failure(http::status::bad_request, errors.first->message);
    for (const LiveCommand command : {LiveCommand::kStop, LiveCommand::kPause, LiveCommand::kResume,
                                      LiveCommand::kZero, LiveCommand::kRecover}) {
      if (name == to_string(command)) return result_of(console_.supervisor.command(command));
    }
    return failure(http::status::bad_request,
                   "body: /command: must be stop, pause, resume, zero or recover");
  }

  Answer start(const json& body) {
    JsonErrors errors{"body", {}};
    StrictObject object(body, "", errors);
    constexpr double kLeast_s = 1e-3;
    StartRequest request;
    const std::string scene = object.string("scene");
    std::string asset;
    if (object.has("asset")) asset = object.string("asset");
    if (object.has("duration_s"))
      request.duration_s = object.number("duration_s", kLeast_s, kMaxDuration_s);
    if (object.has("device")) request.device = object.string("device");
    if (object.has("clock")) request.clock = object.string("clock");
    if (object.has("force_law")) request.force_law = object.string("force_law");
    object.finish();
    if (errors.first) return failure(http::status::bad_request, errors.first->message);
    // Another device is the matter of who starts the console, not of a page.
    if (!request.device.empty() && request.device != "inproc" && request.device != "sim")
      return failure(http::status::bad_request, "body: /device: must be inproc or sim");
    if (request.clock != "real" && request.clock != "virtual")
      return failure(http::status::bad_request, "body: /clock: must be real or virtual");
    if (!request.force_law.empty() && !force_law_from_string(request.force_law))
      return failure(http::status::bad_request, "body: /force_law: must be " + force_law_names());
    const auto scene_file = console_.files.find(scene);
    if (!scene_file) return failure(http::status::not_found, scene_file.error().message);
    request.scene = *scene_file;
    if (!asset.empty()) {
      const auto asset_file = console_.files.find(asset);
      if (!asset_file) return failure(http::status::not_found, asset_file.error().message);
      request.asset = *asset_file;
    }
    return result_of(console_.supervisor.start(request));
  }

  void get(const Target& target, Role role) {
    const std::string& path = target.path;
    if (path == "/api/folder") return get_folder(role);
    if (path == "/api/bone") return get_bone(target);
    if (path == "/api/recording") return get_recording(target);
    if (path == "/api/report") return get_report(target);
    if (path == "/api/log") return get_log();
    send(failure(http::status::not_found, "there is no such path"));
  }

  void get_folder(Role role) {
    const Supervisor& session = console_.supervisor;
    std::string rest = ",\"session\":" + (session.about().empty() ? "null" : session.about()) +
                       ",\"state\":\"" + to_string(session.state()) + "\",\"role\":\"" +
                       to_string(role) + "\"";
    if (!console_.settings.playback.empty()) rest += ",\"playback\":" + console_.settings.playback;
    later([this, rest = std::move(rest)]() -> Answer {
      std::string list = console_.files.list();
      list.pop_back();
      return {http::status::ok, "application/json", list + rest + "}", kPolicyOfData};
    });
  }

  void get_bone(const Target& target) {
    std::filesystem::path scene, asset;
    if (target.parameter("session") == "1") {
      scene = console_.supervisor.scene_file();
      asset = console_.supervisor.asset_file();
      if (scene.empty()) return send(failure(http::status::conflict, "there is no session"));
    } else {
      const auto found = console_.files.find(target.parameter("scene"));
      if (!found) return send(failure(http::status::not_found, found.error().message));
      scene = *found;
      if (const std::string name = target.parameter("asset"); !name.empty()) {
        const auto found_asset = console_.files.find(name);
        if (!found_asset)
          return send(failure(http::status::not_found, found_asset.error().message));
        asset = *found_asset;
      }
    }
    later([this, scene, asset] { return bone(scene, asset); });
  }

  /// On the worker thread. The last one is kept: all pages of a session ask for it.
  Answer bone(const std::filesystem::path& scene, const std::filesystem::path& asset) {
    std::string key = scene.string() + '\n' + asset.string();
    std::error_code error;
    const Result<Scene> read = read_scene(scene);
    if (!read) return failure(http::status::unprocessable_entity, read.error().message);
    for (const auto& file : {scene, asset.empty() ? read->asset : asset}) {
      const auto time = std::filesystem::last_write_time(file, error);
      key += '\n' + std::to_string(error ? 0 : time.time_since_epoch().count());
    }
    if (console_.bone == nullptr || console_.bone_key != key) {
      Result<std::string> made = bone_of(scene, asset);
      if (!made) return failure(http::status::unprocessable_entity, made.error().message);
      console_.bone = std::make_shared<const std::string>(std::move(*made));
      console_.bone_key = key;
    }
    return {http::status::ok, "application/octet-stream", *console_.bone, kPolicyOfData};
  }

  void get_recording(const Target& target) {
    const auto file = console_.files.find(target.parameter("file"));
    if (!file) return send(failure(http::status::not_found, file.error().message));
    later([file = *file]() -> Answer {
      Result<std::string> rows = rows_of(file);
      if (!rows) return failure(http::status::unprocessable_entity, rows.error().message);
      return {http::status::ok, "application/octet-stream", std::move(*rows), kPolicyOfData};
    });
  }

  void get_report(const Target& target) {
    constexpr std::uint64_t kMostReport = std::uint64_t{64} << 20;
    std::filesystem::path name = target.parameter("file");
    if (name.extension() == ".csv") name.replace_extension(".html");
    const auto file = console_.files.find(name.string());
    if (!file || file->extension() != ".html")
      return send(
          failure(http::status::not_found, file ? "it is no report" : file.error().message));
    later([file = *file]() -> Answer {
      const auto bytes = read_file(file, kMostReport);
      if (!bytes) return failure(http::status::unprocessable_entity, bytes.error().message);
      return {http::status::ok, "text/html; charset=utf-8",
              std::string(bytes->begin(), bytes->end()), kPolicyOfReport};
    });
  }

  void get_log() {
    const std::filesystem::path file = console_.supervisor.log_file();
    later([file]() -> Answer {
      constexpr std::streamoff kLast = 64 << 10;
      std::ifstream in(file, std::ios::binary | std::ios::ate);
      std::string text;
      if (in) {
        const std::streamoff size = in.tellg();
        in.seekg(std::max<std::streamoff>(0, size - kLast));
        text.resize(static_cast<std::size_t>(std::min(size, kLast)));
        in.read(text.data(), static_cast<std::streamsize>(text.size()));
        text.resize(static_cast<std::size_t>(in.gcount()));
      }
      return {http::status::ok, "text/plain; charset=utf-8", std::move(text), kPolicyOfData};
    });
  }

  /// The answer of `work`, which runs on the worker thread.
  void later(std::function<Answer()> work) {
    stream_.expires_never();
    net::post(console_.worker, [self = shared_from_this(), work = std::move(work)] {
      auto answer = std::make_shared<Answer>();
      try {
        *answer = work();
      } catch (const std::exception& thrown) {  // a hostile file must not end the console
        *answer = failure(http::status::internal_server_error,
                          std::string("internal error: ") + thrown.what());
      }
      net::post(self->console_.context, [self, answer] { self->send(std::move(*answer)); });
    });
  }

  void send(Answer answer) {
    auto response = std::make_shared<Response>(answer.status, version_);
    response->set(http::field::content_type, answer.type);
    response->set(http::field::cache_control, kNoStore);
    response->set("X-Content-Type-Options", "nosniff");
    response->set("Referrer-Policy", "no-referrer");
    response->set("Cross-Origin-Resource-Policy", "same-origin");
    response->set("Content-Security-Policy", answer.policy);
    response->keep_alive(keep_);
    response->body() = std::move(answer.body);
    response->prepare_payload();
    stream_.expires_after(kRequestWithin);
    http::async_write(stream_, *response,
                      [self = shared_from_this(), response](beast::error_code error, std::size_t) {
                        if (error) return;
                        if (self->keep_) return self->read();
                        beast::error_code ignored;
                        self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
                        self->drain();
                      });
  }

  /// Reads what is still on its way, for a while: closing with it unread would reset the
  /// connection, and the answer with it.
  void drain() {
    buffer_.consume(buffer_.size());
    stream_.expires_after(kDrainWithin);
    stream_.async_read_some(buffer_.prepare(kMostBody),
                            [self = shared_from_this()](beast::error_code error, std::size_t) {
                              if (!error && ++self->drained_ < kMostDrained) self->drain();
                            });
  }

  void open_page(const Request& request) {
    if (count_living(console_.pages) >= kMostPages)
      return refuse(http::status::service_unavailable, "a WebSocket beyond 16");
    auto page = std::make_shared<LivePage>(console_, std::move(stream_), from_);
    console_.pages.push_back(page);
    page->run(request);
  }

  Console& console_;
  beast::tcp_stream stream_;
  std::string from_;
  beast::flat_buffer buffer_{kMostHeader + kMostBody};
  std::optional<http::request_parser<http::string_body>> parser_;
  unsigned version_ = 11;
  bool keep_ = false, is_idle_ = true;
  int drained_ = 0;
};

class Server {
 public:
  Server(Console& console, tcp::acceptor acceptor)
      : console_(console),
        acceptor_(std::move(acceptor)),
        timer_(console.context),
        signals_(console.context, SIGINT, SIGTERM, SIGHUP) {
    console_.poll_soon = [this] {
      timer_.expires_after(Clock::duration::zero());
      wait();
    };
  }

  void run() {
    accept();
    poll();
    await_signal();
    console_.context.run();
    console_.worker.join();
  }

 private:
  void accept() {
    acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (error == net::error::operation_aborted) return;
      if (!error) open(std::move(socket));
      // Out of descriptors: they come back when connections end.
      if (error) {
        retry_.expires_after(std::chrono::milliseconds(100));
        retry_.async_wait([this](beast::error_code) { accept(); });
        return;
      }
      accept();
    });
  }

  void open(tcp::socket socket) {
    beast::error_code error;
    const tcp::endpoint peer = socket.remote_endpoint(error);
    if (error) return;
    socket.set_option(tcp::no_delay(true), error);
    auto& all = console_.connections;
    if (count_living(all) >= kMostConnections) {
      console_.log.refused("a connection beyond 64", text_of(peer));
      for (const auto& one : all) {
        const auto connection = one.lock();
        if (!connection || !connection->is_idle()) continue;
        connection->close();
        break;
      }
      if (all.size() >= 2 * kMostConnections) return;
    }
    auto connection = std::make_shared<HttpConnection>(console_, std::move(socket), text_of(peer));
    all.push_back(connection);
    connection->read();
  }

  void poll() {
    const auto now = Clock::now();
    const std::uint64_t snapshots = console_.supervisor.snapshots();
    console_.supervisor.poll(now);
    console_.has_new_snapshot = console_.supervisor.snapshots() != snapshots;
    for (std::size_t i = 0; i < console_.pages.size(); ++i) {
      if (const auto page = console_.pages[i].lock()) page->pump(now);
    }
    count_living(console_.pages);
    if (is_stopping_ && console_.supervisor.end_all(now, kEndWithin)) {
      console_.context.stop();
      return;
    }
    const RunState state = console_.supervisor.state();
    const bool is_live = state == RunState::kRunning || state == RunState::kPaused;
    timer_.expires_after(is_live || is_stopping_ || state == RunState::kStarting ? kPollEvery
                                                                                 : kPollIdle);
    wait();
  }

  void wait() {
    timer_.async_wait([this](beast::error_code error) {
      if (!error) poll();
    });
  }

  void await_signal() {
    signals_.async_wait([this](beast::error_code error, int) {
      if (error) return;
      if (is_stopping_) return console_.context.stop();  // the second time: at once
      is_stopping_ = true;
      beast::error_code ignored;
      acceptor_.close(ignored);
      console_.poll_soon();
      await_signal();
    });
  }

  Console& console_;
  tcp::acceptor acceptor_;
  net::steady_timer timer_, retry_{console_.context};
  net::signal_set signals_;
  bool is_stopping_ = false;
};

}  // namespace

Result<void> serve(const ServerSettings& settings, Files files, PageFiles page) {
  beast::error_code error;
  const net::ip::address address = net::ip::make_address(settings.listen, error);
  if (error) return usage("--listen " + settings.listen + ": is no numerical address");
  net::io_context context(1);
  tcp::acceptor acceptor(context);
  const tcp::endpoint endpoint(address, settings.port);
  acceptor.open(endpoint.protocol(), error);
  if (!error) acceptor.set_option(net::socket_base::reuse_address(true), error);
  if (!error) acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(net::socket_base::max_listen_connections, error);
  if (error)
    return unwritable("cannot listen on " + text_of(endpoint) + ": " + error.message() +
                      "; --port 0 takes any free port");
  const std::uint16_t port = acceptor.local_endpoint().port();
  const std::string host = address.is_unspecified() ? "127.0.0.1"
                           : address.is_v6()        ? "[" + address.to_string() + "]"
                                                    : address.to_string();
  Console console(context, settings, std::move(files), std::move(page),
                  HostNames(address.to_string(), port));
  const std::string link = "http://" + host + ":" + std::to_string(port) + "/#";
  std::printf("operator: %s%s\naudience: %s%s\n", link.c_str(),
              console.tokens.of_operator().c_str(), link.c_str(), console.tokens.of_view().c_str());
  std::fflush(stdout);
  Server(console, std::move(acceptor)).run();
  return {};
}

}  // namespace trocar::runtime
