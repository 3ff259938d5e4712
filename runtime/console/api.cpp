// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/api.h"

#include <nlohmann/json.hpp>

#include "formats/base/json.h"
#include "formats/base/text.h"
#include "formats/session/scene.h"
#include "runtime/console/answers.h"
#include "runtime/report/history.h"
#include "runtime/session/operator_messages.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

template <typename Number>
void append(std::string& bytes, Number number) {
  bytes.append(reinterpret_cast<const char*>(&number), sizeof number);
}

template <typename Number>
void append(std::string& bytes, const std::vector<Number>& numbers) {
  bytes.append(reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(Number));
}

json as_json(const TelemetryEvent& event) {
  json out = {{"seq", event.number}, {"kind", to_string(event.kind)}, {"t_s", event.t_s}};
  const std::string at = text_line(" at %.3f s", event.t_s);
  const FaultWords& words = words_of(event.found.fault);
  std::string text;
  switch (event.kind) {
    case TelemetryEventKind::kPuncture: {
      out.update({{"sheet", event.sheet},
                  {"slice", event.slice},
                  {"cut", event.cut},
                  {"tool_z_m", event.tool_z_m},
                  {"penetration_m", event.penetration_m},
                  {"tip_N", event.tip_N},
                  {"hand_N", event.hand_N},
                  {"trial_force_N", event.trial_force_N}});
      text =
          text_line("slice %d punctured%s: %.2f N at the tip, %.2f N on the hand, depth %.2f mm",
                    event.slice, at.c_str(), event.tip_N, event.hand_N, event.penetration_m * 1e3);
      break;
    }
    case TelemetryEventKind::kBreakThrough:
      out.update({{"sheet", event.sheet},
                  {"at", event.slice},
                  {"tool_z_m", event.tool_z_m},
                  {"tip_N", event.tip_N}});
      text = describe_break_through(event.slice, event.t_s, event.tip_N);
      break;
    case TelemetryEventKind::kFault:
      out.update({{"fault", words.name},
                  {"meaning", words.meaning},
                  {"measured", measured(event.found)},
                  {"advice", words.advice}});
      text = describe(event.found, event.t_s);
      break;
    case TelemetryEventKind::kNotRecovered:
      out.update({{"fault", words.name},
                  {"meaning", words.meaning_in_recovery},
                  {"measured", measured(event.found)},
                  {"advice", words.advice},
                  {"retract_distance_m", event.retract_distance_m}});
      text = "not recovered" + at + ": ";
      text += event.found.fault == Fault::kNone
                  ? text_line("the tool is in material; lift it by %.2f mm",
                              event.retract_distance_m * 1e3)
                  : with_advice(words.meaning_in_recovery, event.found);
      break;
    case TelemetryEventKind::kRecovered:
      out["fault"] = words.name;
      text = std::string("recovered from ") + words.name + at;
      break;
    case TelemetryEventKind::kRecoveryRefused: {
      const std::string why = refusal_words(event.found.fault);
      out.update({{"fault", words.name}, {"why", why}});
      text = "recovery refused" + at + ": " + why;
      break;
    }
    case TelemetryEventKind::kSoftened:
      out["why"] = kSoftenedWords;
      text = "force softened" + at + ": " + kSoftenedWords;
      break;
    case TelemetryEventKind::kCutShown:
      out.update({{"sheet", event.sheet}, {"slice", event.slice}, {"cut", event.cut}});
      text = text_line("slice %d has %u %s%s", event.slice, event.cut,
                       event.cut == 1 ? "hole" : "holes", at.c_str());
      break;
    case TelemetryEventKind::kPaused:
      text = "paused" + at;
      break;
    case TelemetryEventKind::kResumed:
      text = "resumed" + at;
      break;
    case TelemetryEventKind::kHand:
      text = "a hand holds the tool" + at;
      break;
    case TelemetryEventKind::kHandLetGo:
      text = "the hand let go" + at;
      break;
    case TelemetryEventKind::kHandLost:
      text = "the hand was lost" + at + ": nothing came from it for 250 ms, so it lets go";
      break;
    case TelemetryEventKind::kXrayShot:
      text = "X-ray shot" + at;
      break;
    case TelemetryEventKind::kXrayOn:
      text = "X-ray screening began" + at;
      break;
    case TelemetryEventKind::kXrayOff:
      text = "X-ray screening ended" + at;
      break;
    case TelemetryEventKind::kEnded:
      out.update({{"end", to_string(event.end)}, {"fault", words.name}});
      text = "ended" + at;
      if (event.end == TelemetryEnd::kInterrupted) text += ": stopped";
      if (event.end == TelemetryEnd::kFault) text += std::string(": ") + words.meaning;
      break;
  }
  out["text"] = std::move(text);
  return out;
}

/// The answer about a file that cannot be used, without the names of the console's folders.
Answer unprocessable(const HiddenTexts& hidden, const Error& error) {
  return failure(kUnprocessable, hidden.hide(error.message));
}

Answer binary(std::string body) {
  return {200, "application/octet-stream", std::move(body)};
}

Answer result_of(ConsoleState& console, const Result<void>& result) {
  if (console.poll_soon) console.poll_soon();
  if (!result) return failure(kConflict, console.supervisor.hidden().hide(result.error().message));
  return {200, "application/json", R"({"ok":true})"};
}

Answer command(ConsoleState& console, StrictObject& object, const JsonErrors& errors) {
  const std::string name = object.string("command");
  object.finish();
  if (errors.first) return failure(kBadRequest, errors.first->message);
  for (const TelemetryCommand command :
       {TelemetryCommand::kStop, TelemetryCommand::kPause, TelemetryCommand::kResume,
        TelemetryCommand::kZero, TelemetryCommand::kRecover}) {
    if (name == to_string(command)) return result_of(console, console.supervisor.command(command));
  }
  return failure(kBadRequest, "body: /command: must be stop, pause, resume, zero or recover");
}

Answer xray(ConsoleState& console, StrictObject& object, const JsonErrors& errors) {
  const std::string take = object.string("take");
  object.finish();
  if (errors.first) return failure(kBadRequest, errors.first->message);
  for (const auto& [name, request] :
       {std::pair("shot", XrayRequest::kShot), std::pair("screening", XrayRequest::kScreen),
        std::pair("nothing", XrayRequest::kEnd)}) {
    if (take == name) return result_of(console, console.supervisor.xray(request));
  }
  return failure(kBadRequest, "body: /take: must be shot, screening or nothing");
}

/// Reads the device: the name or the index of one that the console offers. Without one it is the first. Nothing else is
/// accepted, because only the person who starts the console may name a device or its files.
DeviceChoice device(const ConsoleState& console, StrictObject& object) {
  const std::vector<DeviceChoice>& offered = console.supervisor.devices();
  const json* const value = object.optional_value("device");
  if (value == nullptr) return offered.front();
  if (value->is_number_unsigned() && value->get<std::uint64_t>() < offered.size())
    return offered[value->get<std::size_t>()];
  if (value->is_string()) {
    const auto& name = value->get_ref<const std::string&>();
    for (const DeviceChoice& each : offered)
      if (each.name == name) return each;
    // These have no motors, and pages could always choose them.
    if (name == kInProcess || name == kSimulator) return {name, {}};
  }
  object.error("device", "must be the name or the index of a device that this console offers");
  return {};
}

Answer test_device(ConsoleState& console, StrictObject& object, const JsonErrors& errors) {
  const DeviceChoice chosen = device(console, object);
  object.finish();
  if (errors.first) return failure(kBadRequest, errors.first->message);
  return result_of(console, console.supervisor.test_device(chosen));
}

Answer new_scene(ConsoleState& console, StrictObject& object, const JsonErrors& errors) {
  constexpr double kMost_mm = 1e4;
  NewSceneRequest request;
  std::string scene, asset;
  if (object.has("asset")) asset = object.string("asset");
  if (asset.empty() || object.has("scene")) scene = object.string("scene");
  request.name = object.string("name");
  for (const auto& [key, into] :
       {std::pair{"entry_mm", &request.entry_mm}, std::pair{"target_mm", &request.target_mm}}) {
    if (!object.has(key)) continue;
    object.numbers(key, into->emplace(), -kMost_mm, kMost_mm, true);
  }
  request.has_live_hand = object.boolean("live_hand");
  request.device = device(console, object);
  object.finish();
  if (errors.first) return failure(kBadRequest, errors.first->message);
  if (const std::string why = trainee_code_error(request.name);
      request.name.empty() || !why.empty())
    return failure(kBadRequest, "body: /name: " + (why.empty() ? "must not be empty" : why));
  if (request.has_live_hand && request.device.name != kInProcess)
    return failure(kBadRequest, "body: /live_hand: is for the device inproc");
  if (request.target_mm && !request.entry_mm)
    return failure(kBadRequest, "body: /target_mm: needs entry_mm");
  if (const auto ok = console.files.find(asset.empty() ? scene : asset).into(request.asset); !ok)
    return failure(kNotFound, console.supervisor.hidden().hide(ok.error().message));
  if (asset.empty()) {
    const Result<Scene> read = read_scene(request.asset);
    if (!read) return failure(kBadRequest, console.supervisor.hidden().hide(read.error().message));
    request.asset = read->asset;
  }
  return result_of(console, console.supervisor.make_scene(request));
}

Trainee trainee(StrictObject& object) {
  Trainee out;
  for (const auto& [key, into] :
       {std::pair{"trainee", &out.code}, std::pair{"course", &out.course}}) {
    if (!object.has(key)) continue;
    *into = object.string(key);
    if (const std::string why = trainee_code_error(*into); !why.empty()) object.error(key, why);
  }
  if (object.has("attempt")) out.attempt = object.integer("attempt", 1, kMaxAttempt);
  return out;
}

/// Finds the files of a scene and, if its name is not empty, of an asset.
Result<void> find_files(const Files& files, const std::string& scene, const std::string& asset,
                        std::filesystem::path& scene_file, std::filesystem::path& asset_file) {
  if (auto ok = files.find(scene).into(scene_file); !ok || asset.empty()) return ok;
  return files.find(asset).into(asset_file);
}

Answer start(ConsoleState& console, StrictObject& object, const JsonErrors& errors) {
  constexpr double kMin_s = 1e-3;
  StartRequest request;
  const std::string scene = object.string("scene");
  std::string asset;
  if (object.has("asset")) asset = object.string("asset");
  if (object.has("duration_s"))
    request.duration_s = object.number("duration_s", kMin_s, kMaxDuration_s);
  request.device = device(console, object);
  if (object.has("clock")) request.clock = object.string("clock");
  if (object.has("force_law")) request.force_law = object.string("force_law");
  request.trainee = trainee(object);
  object.finish();
  if (errors.first) return failure(kBadRequest, errors.first->message);
  if (request.clock != "real" && request.clock != "virtual")
    return failure(kBadRequest, "body: /clock: must be real or virtual");
  if (!request.force_law.empty() && !force_law_from_string(request.force_law))
    return failure(kBadRequest, "body: /force_law: must be " + force_law_names());
  if (const auto ok = find_files(console.files, scene, asset, request.scene, request.asset); !ok)
    return failure(kNotFound, ok.error().message);
  return result_of(console, console.supervisor.start(request));
}

Reply get_folder(ConsoleState& console, Role role) {
  const std::string& about = console.supervisor.telemetry().about().json;
  std::string rest = ",\"session\":" + (about.empty() ? "null" : about) + ",\"state\":\"" +
                     to_string(console.supervisor.state()) + "\",\"role\":\"" + to_string(role) +
                     "\"";
  json devices = json::array();
  for (const DeviceChoice& each : console.supervisor.devices())
    devices.push_back({{"name", each.name},
                       {"simulated", each.is_simulated()},
                       {"can_be_tested", each.can_be_tested()}});
  rest += ",\"devices\":" + json_text(devices);
  const bool may_start = console.supervisor.scene_file().empty();  // nothing was started yet
  if (!console.settings.start.empty() && role == Role::kOperator && may_start)
    rest += ",\"start\":" + console.settings.start;
  if (!console.settings.playback.empty()) rest += ",\"playback\":" + console.settings.playback;
  return [&console, rest = std::move(rest)]() -> Answer {
    std::string list = console.files.list();
    list.pop_back();
    return {200, "application/json", list + rest + "}"};
  };
}

using MakeBone = Result<std::string> (*)(const std::filesystem::path& scene,
                                         const std::filesystem::path& asset);

/// Answers /api/bone and /api/volume. Runs on the worker thread.
Answer bone(BoneCache& cache, MakeBone make, const HiddenTexts& hidden,
            const std::filesystem::path& scene, const std::filesystem::path& asset) {
  std::string key = scene.string() + '\n' + asset.string();
  std::error_code error;
  const Result<Scene> read = read_scene(scene);
  if (!read) return unprocessable(hidden, read.error());
  for (const auto& file : {scene, asset.empty() ? read->asset : asset}) {
    const auto time = std::filesystem::last_write_time(file, error);
    key += '\n' + std::to_string(error ? 0 : time.time_since_epoch().count());
  }
  if (cache.key != key) {
    Result<std::string> made = make(scene, asset);
    if (!made) return unprocessable(hidden, made.error());
    cache = {std::move(key), std::make_shared<const std::string>(std::move(*made))};
  }
  Answer answer = binary({});
  answer.shared = cache.answer;
  return answer;
}

Reply get_bone(ConsoleState& console, const RequestTarget& target, BoneCache& cache,
               MakeBone make) {
  std::filesystem::path scene, asset;
  if (target.parameter("session") == "1") {
    scene = console.supervisor.scene_file();
    asset = console.supervisor.asset_file();
    if (scene.empty()) return failure(kConflict, "there is no session");
  } else {
    if (const auto ok = find_files(console.files, target.parameter("scene"),
                                   target.parameter("asset"), scene, asset);
        !ok)
      return failure(kNotFound, ok.error().message);
  }
  return [&cache, make, hidden = console.supervisor.hidden(), scene, asset] {
    return bone(cache, make, hidden, scene, asset);
  };
}

Reply get_recording(const ConsoleState& console, const RequestTarget& target) {
  const auto file = console.files.find(target.parameter("file"));
  if (!file) return failure(kNotFound, file.error().message);
  return [file = *file, hidden = console.supervisor.hidden()]() -> Answer {
    Result<std::string> rows = rows_of(file);
    return rows ? binary(std::move(*rows)) : unprocessable(hidden, rows.error());
  };
}

Reply get_report(const ConsoleState& console, const RequestTarget& target) {
  constexpr std::uint64_t kMaxReport = std::uint64_t{64} << 20;
  std::filesystem::path name = target.parameter("file");
  if (name.extension() == ".csv") name.replace_extension(".html");
  const auto file = console.files.find(name.string());
  if (!file) return failure(kNotFound, file.error().message);
  if (file->extension() != ".html") return failure(kNotFound, "the file is not a session report");
  return [file = *file, hidden = console.supervisor.hidden()]() -> Answer {
    const auto bytes = read_file(file, kMaxReport);
    if (!bytes) return unprocessable(hidden, bytes.error());
    return {200, "text/html; charset=utf-8", std::string(bytes->begin(), bytes->end()),
            report_policy()};
  };
}

Reply get_history(const ConsoleState& console) {
  std::filesystem::path folder = console.files.sessions();
  std::error_code error;
  if (folder.empty() || !std::filesystem::is_directory(folder, error))
    return failure(kNotFound, "there are no sessions yet");
  return [folder = std::move(folder), hidden = console.supervisor.hidden()]() -> Answer {
    const Result<History> history = read_history(folder);
    if (!history) return unprocessable(hidden, history.error());
    return {200, "text/html; charset=utf-8", history_page(*history), report_policy()};
  };
}

Reply get_log(const ConsoleState& console) {
  return [file = console.supervisor.log_file(), hidden = console.supervisor.hidden()]() -> Answer {
    return {200, "text/plain; charset=utf-8", hidden.hide(tail_of(file))};
  };
}

/// Answers with the JSON of DeviceTest::answer() or SceneMaker::answer().
Reply get_json(std::function<std::string()> answer) {
  return [answer = std::move(answer)]() -> Answer { return {200, "application/json", answer()}; };
}

Answer post(ConsoleState& console, const ApiRequest& request) {
  if (!request.is_post) return method_not_allowed();
  if (request.role != Role::kOperator) {
    console.log.refused("a command from an audience", request.from);
    return failure(kForbidden, "an audience may watch, not command");
  }
  const Result<json> body = parse_strict_json(request.body, "body");
  if (!body) return failure(kBadRequest, body.error().message);
  if (!body->is_object()) return failure(kBadRequest, "body: must be an object");
  JsonErrors errors{"body", {}};
  StrictObject object(*body, "", errors);
  const std::string& path = request.target.path;
  if (path == "/api/start") return start(console, object, errors);
  if (path == "/api/xray") return xray(console, object, errors);
  if (path == "/api/new_scene") return new_scene(console, object, errors);
  return path == "/api/test" ? test_device(console, object, errors)
                             : command(console, object, errors);
}

}  // namespace

std::string event_message(const TelemetryEvent& event) {
  return json_text(as_json(event));
}

std::string snapshot_message(const std::vector<double>& values) {
  std::string bytes;
  append(bytes, values);
  return bytes;
}

std::string history_message(const std::vector<ForceHistory::Point>& points) {
  std::string bytes;
  for (const ForceHistory::Point& point : points)
    for (const double number : {point.t_s, point.force_N, point.tip_z_m})
      append(bytes, number);
  return bytes;
}

std::string mesh_message(std::int32_t sheet, std::uint32_t cuts, std::int32_t slice,
                         const std::vector<float>& positions, std::size_t floats_of_vertex,
                         const std::vector<float>& hu,
                         const std::vector<std::uint32_t>& triangles) {
  std::string bytes;
  bytes.reserve(24 + 4 * (positions.size() + hu.size() + triangles.size()));
  append(bytes, sheet);
  append(bytes, cuts);
  append(bytes, slice);
  append(bytes, static_cast<std::uint32_t>(positions.size() / floats_of_vertex));
  append(bytes, static_cast<std::uint32_t>(triangles.size() / 3));
  append(bytes, static_cast<std::uint32_t>(hu.empty() ? 0 : 1));
  append(bytes, positions);
  append(bytes, hu);
  append(bytes, triangles);
  return bytes;
}

Answer failure(unsigned status, const std::string& message) {
  return {status, "application/json", json_text({{"ok", false}, {"error", message}})};
}

Answer method_not_allowed() {
  return failure(kMethodNotAllowed, "another method is needed here");
}

Answer answer_emergency_stop(ConsoleState& console) {
  return result_of(console, console.supervisor.emergency_stop());
}

Reply answer_api(ConsoleState& console, const ApiRequest& request) {
  const std::string& path = request.target.path;
  if (path == "/api/start" || path == "/api/command" || path == "/api/xray" ||
      ((path == "/api/test" || path == "/api/new_scene") && !request.is_get))
    return post(console, request);
  if (!request.is_get) return method_not_allowed();
  if (path == "/api/folder") return get_folder(console, request.role);
  if (path == "/api/bone") return get_bone(console, request.target, console.bone, bone_of);
  if (path == "/api/volume") return get_bone(console, request.target, console.volume, volume_of);
  if (path == "/api/recording") return get_recording(console, request.target);
  if (path == "/api/report") return get_report(console, request.target);
  if (path == "/api/history") return get_history(console);
  if (path == "/api/log") return get_log(console);
  const HiddenTexts& hidden = console.supervisor.hidden();
  if (path == "/api/test") return get_json(console.supervisor.test().answer(hidden));
  if (path == "/api/new_scene") return get_json(console.supervisor.scene_maker().answer(hidden));
  return failure(kNotFound, "there is no such path");
}

}  // namespace trocar::runtime
