// SPDX-License-Identifier: Apache-2.0
#include "runtime/report/history.h"

#include <sys/stat.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <limits>
#include <map>
#include <set>
#include <system_error>
#include <tuple>

#include "embedded/runtime/report/history_page.js.h"
#include "formats/base/files.h"
#include "formats/base/html_page.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "formats/session/recording.h"
#include "formats/session/trainee.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

constexpr const char* kReport = "trocar.session-report/1";
constexpr const char* kSummary = "trocar.summary/1";
// Files of the console that are no sessions: a note beside each session, and tests of devices.
constexpr const char *kConsoleNote = "trocar.console-session/1",
                     *kDeviceTest = "trocar.device-test/1";
constexpr std::uint64_t kMaxFile = std::uint64_t{16} << 20;
constexpr std::size_t kMaxText = 200;

/// A figure of the history, and where a report and a summary have it; empty: they have none.
struct Figure {
  const char *name, *title, *unit;
  const char *in_report, *in_summary;
};
constexpr std::array kFigures{
    Figure{"goals_met", "goals met", "", "/goals_met", ""},
    Figure{"total_s", "duration", "s", "/time/total_s", ""},
    Figure{"contact_to_last_puncture_s", "first contact to last puncture", "s",
           "/time/contact_to_last_puncture_s", ""},
    Figure{"xray_shots", "X-ray shots", "", "/xray/shots", "/xray/shots"},
    Figure{"xray_s", "X-ray screening", "s", "/xray/screening_s", "/xray/screening_s"},
    Figure{"path_m", "path length", "m", "/path/length_m", ""},
    Figure{"reentries", "re-entries", "", "/attempts/reentries", ""},
    Figure{"force_max_N", "largest force", "N", "/force/max_N", "/max_force_N"},
    Figure{"force_time_N_s", "force-time integral", "N s", "/force/time_integral_N_s", ""},
    Figure{"plunge_max_m", "largest plunge", "m", "/plunge_max_m", ""},
    Figure{"zone_entries", "entries into forbidden zones", "", "", ""},
    Figure{"wall_outside_m", "outside bone, final position", "m", "/walls/final/outside_m", ""},
    Figure{"target_m", "distance to the target", "m", "/target/closest_m", ""},
    Figure{"faults", "faults", "", "/faults_count", "/faults_count"},
};

struct Session {
  std::string file, scene, end, time;
  std::int64_t changed_ns = 0;
  Trainee trainee;
  /// How many the scene states, and how many of them were attempted.
  std::optional<std::int64_t> goals, goals_attempted;
  std::array<std::optional<double>, kFigures.size()> figure;
};

/// Returns the value at a pointer, or null if it or something on the way is missing or null.
const json* value_at(const json& document, const std::string& pointer) {
  const json::json_pointer at(pointer);
  if (pointer.empty() || !document.contains(at)) return nullptr;
  const json& value = document.at(at);
  return value.is_null() ? nullptr : &value;
}

/// Reads a number of a report or a summary. `why` receives what is wrong with it.
std::optional<double> number_at(const json& document, const std::string& pointer,
                                std::string& why) {
  constexpr double kMost = 1e9;
  const json* const value = value_at(document, pointer);
  if (value == nullptr) return std::nullopt;
  if (!value->is_number() || !(std::abs(value->get<double>()) <= kMost)) {
    if (why.empty()) why = pointer + ": must be a number up to 1e9, or null";
    return std::nullopt;
  }
  return value->get<double>();
}

std::string text_at(const json& document, const std::string& pointer, std::string& why) {
  const json* const value = value_at(document, pointer);
  if (value != nullptr && value->is_string() && !value->get<std::string>().empty())
    return value->get<std::string>().substr(0, kMaxText);
  if (why.empty()) why = pointer + ": must be a text";
  return {};
}

Trainee trainee_at(const json& document, std::string& why) {
  Trainee trainee;
  for (const auto& [pointer, into] :
       {std::pair{"/trainee/code", &trainee.code}, std::pair{"/trainee/course", &trainee.course}}) {
    if (value_at(document, pointer) == nullptr) continue;
    *into = text_at(document, pointer, why);
    if (const std::string wrong = trainee_code_error(*into); why.empty() && !wrong.empty())
      why = std::string(pointer) + ": " + wrong;
  }
  if (const auto attempt = number_at(document, "/trainee/attempt", why)) {
    const bool is_whole = *attempt == std::floor(*attempt) && std::abs(*attempt) <= 1e9;
    trainee.attempt = is_whole ? static_cast<std::int64_t>(*attempt) : 0;
    if (const std::string wrong = attempt_error(*trainee.attempt); why.empty() && !wrong.empty())
      why = "/trainee/attempt: " + wrong;
  }
  return trainee;
}

std::optional<double> zone_entries(const json& document, std::string& why) {
  const json* const zones = value_at(document, "/zones");
  if (zones == nullptr || !zones->is_array() || zones->empty()) return std::nullopt;
  double sum = 0;
  for (const json& zone : *zones)
    sum += number_at(zone, "/breaches_count", why).value_or(0);
  return sum;
}

/// Returns how many of a summary's faults are commands of the operator, pauses and forces switched
/// off. A report counts them apart from the faults.
double operator_stops(const json& summary) {
  const json* const faults = value_at(summary, "/faults");
  if (faults == nullptr || !faults->is_array()) return 0;
  return static_cast<double>(std::count_if(faults->begin(), faults->end(), [](const json& each) {
    const json* const fault = value_at(each, "/fault");
    if (fault == nullptr || !fault->is_string()) return false;
    const auto name = fault->get<std::string>();
    return name == to_string(Fault::kPaused) || name == to_string(Fault::kForcesOff);
  }));
}

/// Returns the session of a document. Errors: (refused) what is wrong with it.
Result<Session> session_of(const json& document, bool is_report) {
  std::string why;
  Session out;
  out.scene = text_at(document, "/scene", why);
  out.end = text_at(document, "/end", why);
  out.trainee = trainee_at(document, why);
  for (std::size_t i = 0; i < kFigures.size(); ++i)
    out.figure[i] =
        number_at(document, is_report ? kFigures[i].in_report : kFigures[i].in_summary, why);
  const auto at = [&out](std::string_view name) -> std::optional<double>& {
    const auto found = std::find_if(kFigures.begin(), kFigures.end(),
                                    [name](const Figure& figure) { return name == figure.name; });
    return out.figure[static_cast<std::size_t>(found - kFigures.begin())];
  };
  if (is_report) {
    at("zone_entries") = zone_entries(document, why);
    const json* const goals = value_at(document, "/goals");
    if (goals != nullptr && goals->is_array() && !goals->empty())
      out.goals = static_cast<std::int64_t>(goals->size());
    if (!out.goals) at("goals_met").reset();
    if (const auto tried = number_at(document, "/goals_attempted", why); tried && out.goals)
      out.goals_attempted = static_cast<std::int64_t>(*tried);
  } else {
    const auto ticks = number_at(document, "/ticks", why),
               rate_Hz = number_at(document, "/rate_Hz", why);
    if (ticks && rate_Hz && *rate_Hz > 0) at("total_s") = *ticks / *rate_Hz;
    if (auto& faults = at("faults")) *faults = std::max(0.0, *faults - operator_stops(document));
  }
  if (!why.empty()) return refused(why);
  return out;
}

/// One line without control characters, for a terminal and a list.
std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(),
      [](char c) { return static_cast<unsigned char>(c) < ' ' || c == '\x7f'; }, '?');
  return text;
}

/// Returns the names, relative to `folder` and in order, of the files that are to be read.
/// `unfinished` receives the recordings of sessions that were killed.
Result<std::vector<std::string>> json_files(const std::filesystem::path& folder,
                                            std::vector<std::string>& unfinished) {
  std::vector<std::string> names;
  std::error_code error;
  std::filesystem::recursive_directory_iterator entry(
      folder, std::filesystem::directory_options::skip_permission_denied, error);
  if (error) return refused(folder.string() + ": " + error.message());
  for (const std::filesystem::recursive_directory_iterator end; entry != end;) {
    std::error_code ignored;
    if (entry.depth() >= kMaxHistoryDepth) entry.disable_recursion_pending();
    const std::string name = entry->path().lexically_relative(folder).string();
    if (entry->path().extension() == ".json" && !entry->is_symlink(ignored) &&
        entry->is_regular_file(ignored))
      names.push_back(name);
    if (is_partial_name(name) && !entry->is_symlink(ignored) && entry->is_regular_file(ignored) &&
        unfinished.size() < kMaxHistoryFiles && !is_being_recorded(entry->path()))
      unfinished.push_back(name);
    if (names.size() > kMaxHistoryFiles)
      return refused(folder.string() + ": has more than " + std::to_string(kMaxHistoryFiles) +
                     " files that end in .json");
    entry.increment(error);  // opens the entry if it is a folder
    if (error)
      return refused(folder.string() + ": not all of its folders can be read, " + one_line(name) +
                     " or what follows it: " + error.message());
  }
  std::sort(names.begin(), names.end());
  std::sort(unfinished.begin(), unfinished.end());
  return names;
}

struct ReadFile {
  json document;
  bool is_report = false, is_no_session = false;
};

/// Errors: (refused) why the file is skipped.
Result<ReadFile> read_figures(const std::filesystem::path& file, const std::string& name) {
  const auto bytes = read_file(file, kMaxFile);
  if (!bytes) return refused(name + ": cannot be read, or is larger than 16 MiB");
  Result<json> document = parse_strict_json(
      std::string_view(reinterpret_cast<const char*>(bytes->data()), bytes->size()), name);
  if (!document) return document.error();
  const json* const schema = document->is_object() ? value_at(*document, "/schema") : nullptr;
  const std::string is = schema != nullptr && schema->is_string() ? schema->get<std::string>() : "";
  const bool is_no_session = is == kConsoleNote || is == kDeviceTest;
  if (is != kReport && is != kSummary && !is_no_session)
    return refused(name + ": is not the figures of a session" +
                   (is.empty() ? "" : " but " + json_text(is.substr(0, kMaxText))));
  return ReadFile{std::move(*document), is == kReport, is_no_session};
}

bool comes_before(const Session& a, const Session& b) {
  const auto key = [](const Session& s) {
    return std::tuple(s.trainee.attempt.value_or(std::numeric_limits<std::int64_t>::max()),
                      s.changed_ns, s.file);
  };
  return key(a) < key(b);
}

json code_or_null(const std::string& code) {
  return code.empty() ? json(nullptr) : json(code);
}

json describe(const Session& session) {
  json figures = json::object();
  for (std::size_t i = 0; i < kFigures.size(); ++i)
    figures[kFigures[i].name] = session.figure[i] ? json(*session.figure[i]) : json(nullptr);
  return {
      {"file", session.file},
      {"time", session.time},
      {"attempt", session.trainee.attempt ? json(*session.trainee.attempt) : json(nullptr)},
      {"end", session.end},
      {"goals", session.goals ? json(*session.goals) : json(nullptr)},
      {"goals_attempted", session.goals_attempted ? json(*session.goals_attempted) : json(nullptr)},
      {"figures", std::move(figures)}};
}

/// Calls use(series, session) for each session of a history's document.
template <typename Use>
void for_each_session(const json& document, const Use& use) {
  for (const json& series : document["series"])
    for (const json& session : series["sessions"])
      use(series, session);
}

std::string shown(const json& value) {
  return value.is_null() ? "" : value.is_string() ? value.get<std::string>() : json_text(value);
}

}  // namespace

Result<History> read_history(const std::filesystem::path& folder) {
  std::vector<std::string> unfinished;
  const Result<std::vector<std::string>> names = json_files(folder, unfinished);
  if (!names) return names.error();
  History history;
  std::set<std::filesystem::path> with_report;  // folders
  std::vector<std::pair<Session, bool>> found;  // true: from a report
  for (const std::string& name : *names) {
    const std::filesystem::path file = folder / name;
    const Result<ReadFile> read = read_figures(file, name);
    if (read && read->is_no_session) continue;
    Result<Session> session =
        read ? session_of(read->document, read->is_report) : Result<Session>(read.error());
    if (!session) {
      const std::string& why = session.error().message;
      history.skipped.push_back(one_line(read ? std::string(name).append(": ").append(why) : why));
      continue;
    }
    session->file = one_line(name);
    struct ::stat status {};
    if (::stat(file.c_str(), &status) == 0) {
      constexpr std::int64_t kNanoseconds = 1'000'000'000;
      session->time = utc_text(status.st_mtim.tv_sec);
      session->changed_ns = status.st_mtim.tv_sec * kNanoseconds + status.st_mtim.tv_nsec;
    }
    if (read->is_report) with_report.insert(file.parent_path());
    found.emplace_back(std::move(*session), read->is_report);
  }
  for (const std::string& name : unfinished) {
    if (with_report.contains((folder / name).parent_path())) continue;
    history.skipped.push_back(one_line(name) +
                              ": its session did not end properly; trocar-run replay SCENE " +
                              "makes its report");
  }
  std::map<std::array<std::string, 3>, std::vector<Session>> all;
  for (auto& [session, is_report] : found) {
    if (!is_report && with_report.contains((folder / session.file).parent_path())) continue;
    all[{session.trainee.course, session.trainee.code, session.scene}].push_back(
        std::move(session));
    ++history.sessions;
  }
  json document = {{"schema", "trocar.history/1"},
                   {"program", "trocar-run " TROCAR_VERSION},
                   {"use", "for training, not for planning"},
                   {"figures", json::array()},
                   {"series", json::array()},
                   {"skipped", history.skipped}};
  for (const Figure& figure : kFigures)
    document["figures"].push_back(
        {{"name", figure.name}, {"title", figure.title}, {"unit", figure.unit}});
  for (auto& [key, sessions] : all) {
    std::sort(sessions.begin(), sessions.end(), comes_before);
    json list = json::array();
    for (const Session& session : sessions)
      list.push_back(describe(session));
    document["series"].push_back({{"course", code_or_null(key[0])},
                                  {"trainee", code_or_null(key[1])},
                                  {"scene", key[2]},
                                  {"sessions", std::move(list)}});
  }
  history.json = json_text(document);
  return history;
}

std::string history_text(const History& history) {
  const json document = parse_known_json(history.json);
  std::string text;
  const json* last = nullptr;
  for_each_session(document, [&](const json& series, const json& session) {
    if (&series != last) {
      const std::string trainee = shown(series["trainee"]), course = shown(series["course"]);
      text += std::string(last == nullptr ? "" : "\n") + "trainee " +
              (trainee.empty() ? "not stated" : trainee) + ", course " +
              (course.empty() ? "not stated" : course) + ", scene " +
              one_line(shown(series["scene"])) + "\n" +
              " attempt  time                  goals met (attempted)  duration  path   re-entries  "
              "force  force-time"
              "  outside  faults\n"
              "                                                         s         mm               "
              "  N      N s       "
              "  mm\n";
      last = &series;
    }
    const auto cell = [&](const char* name, double factor, const char* format) {
      const json& value = session["figures"][name];
      return value.is_null() ? std::string("-") : text_line(format, factor * value.get<double>());
    };
    std::string goals = "-";
    if (!session["goals"].is_null())
      goals = cell("goals_met", 1, "%.0f") + "/" + shown(session["goals"]);
    if (!session["goals_attempted"].is_null())
      goals += " (" + shown(session["goals_attempted"]) + ")";
    text +=
        text_line("%8s  %s  %21s  %8s  %5s  %10s  %5s  %10s  %7s  %6s\n",
                  session["attempt"].is_null() ? "-" : shown(session["attempt"]).c_str(),
                  shown(session["time"]).c_str(), goals.c_str(), cell("total_s", 1, "%.2f").c_str(),
                  cell("path_m", 1e3, "%.1f").c_str(), cell("reentries", 1, "%.0f").c_str(),
                  cell("force_max_N", 1, "%.1f").c_str(), cell("force_time_N_s", 1, "%.1f").c_str(),
                  cell("wall_outside_m", 1e3, "%.2f").c_str(), cell("faults", 1, "%.0f").c_str());
  });
  return text;
}

std::string history_csv(const History& history) {
  const json document = parse_known_json(history.json);
  std::string csv = "course,trainee,scene,attempt,time,file,end,goals,goals_attempted,";
  for (const Figure& figure : kFigures)
    csv.append(figure.name).append(",");
  csv.back() = '\n';
  for_each_session(document, [&](const json& series, const json& session) {
    for (const char* key : {"course", "trainee", "scene"})
      csv += csv_field(shown(series[key])) + ',';
    for (const char* key : {"attempt", "time", "file", "end", "goals", "goals_attempted"})
      csv += csv_field(shown(session[key])) + ',';
    for (const Figure& figure : kFigures)
      csv += shown(session["figures"][figure.name]) + ',';
    csv.back() = '\n';
  });
  return csv;
}

std::string history_page(const History& history) {
  return html_page("trocar-run history", kHistoryPage, {{"history", history.json}});
}

}  // namespace trocar::runtime
