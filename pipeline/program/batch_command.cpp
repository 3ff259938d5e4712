// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/commands.h"

#include <sched.h>
#include <unistd.h>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <system_error>

#include "formats/base/command_line.h"
#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "pipeline/bake/report.h"
#include "pipeline/batch/garbage.h"
#include "pipeline/batch/scan_files.h"
#include "pipeline/batch/scan_worker.h"
#include "pipeline/open/scan_folder.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/nrrd.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct BatchArguments {
  std::filesystem::path collection, only;
  farm::BatchSettings settings;
  std::string explain;
  double grace_minutes = 60;
  bool dry_run = false, as_json = false, gc = false, prune = false, strict = false, quiet = false;
};

// Options that a collection cannot give as parameters: the store determines the outputs, the batch
// the number of threads, and `input` in the collection the series.
const std::set<std::string>& excluded_options() {
  static const std::set<std::string> names = {"output", "report", "dump-stages", "dump-slice",
                                              "series", "jobs",   "quiet",       "explain"};
  return names;
}

// The options and their values. The options refer to the values, so this object cannot be moved.
struct Parsed {
  CLI::App app{"", kProgram};
  Arguments a;
  Parsed() {
    app.set_help_flag();  // no parameter of a scan
    add_mesh_options(app, a);
  }
};

/// An option of meshing that a collection can give as a parameter.
struct Parameter {
  std::string name;
  bool is_flag;
};

std::vector<Parameter> parameters_of(const CLI::App& app) {
  std::vector<Parameter> out;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames())
      if (!excluded_options().contains(name))
        out.push_back({name, option->get_items_expected_max() == 0});
  }
  return out;
}

std::vector<std::string> names_of(const std::vector<Parameter>& parameters) {
  std::vector<std::string> out;
  out.reserve(parameters.size());
  for (const Parameter& each : parameters)
    out.push_back(each.name);
  return out;
}

Result<void> add_words(const std::vector<Parameter>& known, const std::string& name,
                       const json& value, std::vector<std::string>& words) {
  const std::string given = "parameter " + name + ": ";
  const auto found = std::find_if(known.begin(), known.end(),
                                  [&](const Parameter& each) { return each.name == name; });
  if (found == known.end()) {
    if (excluded_options().contains(name))
      return usage(given + "is not for the scans of a collection");
    return usage(given + "no such option" + did_you_mean(name, names_of(known)));
  }
  if (value.is_boolean() != found->is_flag)
    return usage(given + (found->is_flag ? "must be true or false" : "must be a number or a text"));
  if (found->is_flag) {
    words.push_back("--" + name);
    return {};
  }
  for (const json& one : value.is_array() ? value : json::array({value}))
    words.push_back("--" + name + "=" +
                    (one.is_string() ? one.get<std::string>() : json_text(one)));
  return {};
}

Result<std::unique_ptr<Parsed>> parse_parameters(const json& given) {
  auto out = std::make_unique<Parsed>();
  std::vector<std::string> words = {kProgram};
  const std::vector<Parameter> known = parameters_of(out->app);
  for (const auto& [name, value] : given.items()) {
    if (auto ok = add_words(known, name, value, words); !ok) return ok.error();
  }
  if (auto ok = trocar::parse(out->app, with_preset_options(words)); !ok)
    return usage("parameters: " + ok.error().message);
  out->a.of_preset = added_by_preset(words);
  if (auto ok = complete(out->a); !ok) return ok.error();
  return out;
}

std::vector<farm::NamedFile> files_of(const Arguments& a) {
  const std::string& mask_file = a.stack.solid.mask_file;
  std::vector<farm::NamedFile> out;
  if (!a.hu.empty()) out.push_back({"hu", a.hu});
  if (!a.input_key.empty()) out.push_back({"input-key", a.input_key});
  if (!mask_file.empty()) out.push_back({"mask", mask_file});
  if (!a.names.empty() && !LabelNames::is_table(a.names)) out.push_back({"names", a.names});
  return out;
}

// The option that a key of parameters_json() is of: tolerance_mm is --tolerance.
std::string option_of(std::string key) {
  for (const char* unit : {"_mm3", "_mm2", "_px2", "_lps_mm", "_mm", "_deg", "_hu", "_HU"}) {
    if (!key.ends_with(unit)) continue;
    key.resize(key.size() - std::string_view(unit).size());
    break;
  }
  std::replace(key.begin(), key.end(), '_', '-');
  return key;
}

// Every option that can change a byte of the outputs. Defaults are included, so that giving a default
// explicitly does not change the key, unless the default follows the pixels.
json canonical(const Arguments& a) {
  const json all = parameters_json(a.stack, a.open);
  json out;
  for (const auto& [key, value] : all.items())
    out[option_of(key)] = value;
  const DefaultOptions& follow = a.stack.defaults;
  for (const auto& [option, follows] : {std::pair("tolerance", follow.tolerance),
                                        {"min-region", follow.min_region},
                                        {"lattice-bits", follow.lattice_bits},
                                        {"close", follow.close},
                                        {"min-volume", follow.min_volume}}) {
    if (follows) out[option] = {{"default", out[option]}};
  }
  out["all_labels"] = a.labels && a.labels->all;
  out["any_modality"] = a.open.any_modality;
  out["lines"] = a.stack.lines;
  out["colour"] = a.stack.colours;
  out["names"] = LabelNames::is_table(a.names) ? json(a.names) : json();
  // The default number of triangles of the surface may be exceeded, but a given number may not.
  out["at_most"] = a.stack.surface && a.stack.surface->at_most;
  // A given threshold is not the same as the default with these two options: images, which need
  // --spacing, are refused without one, and other modalities get a warning (check_input()).
  if (a.open.any_modality || a.open.spacing_mm)
    out["threshold_given"] = a.threshold && a.preset.empty();
  return out;
}

// The report without values that differ from run to run or depend on other files in the input's
// folder.
std::string stored_report(json report, const SliceStack& stack) {
  for (const char* key : {"total_ms", "assemble_ms", "stages_ms", "threads", "peak_rss_bytes"})
    report.erase(key);
  for (json& slice : report["slices"])
    slice.erase("ms");
  if (report.contains("surface"))
    for (json& surface : report["surface"])
      surface.erase("ms");
  const std::string name = input_name(stack);
  for (json& warning : report["warnings"]) {
    if (const auto shared = warning.find("shared"); shared != warning.end()) {
      warning["sentence"] = *shared;
      warning.erase("shared");
    }
    if (warning["where"] == name) warning["where"] = "input";
    if (const auto places = warning.find("places"); places != warning.end())
      std::replace(places->begin(), places->end(), json(name), json("input"));
  }
  report["input"] = {
      {"slices", stack.size()}, {"width_px", stack.width()}, {"height_px", stack.height()}};
  if (stack.series) report["input"]["series"] = series_for_report(*stack.series);
  return json_text(report, 1) + "\n";
}

class Opened : public farm::OpenedScan {
 public:
  // `warnings` are the warnings of opening the scan.
  Opened(std::unique_ptr<Parsed> parsed, LabelsWithCt scan, json warnings)
      : parsed_(std::move(parsed)), scan_(std::move(scan)), warnings_(std::move(warnings)) {}

  std::vector<farm::NamedFile> files() const override {
    std::vector<farm::NamedFile> out;
    for (const fs::path& file : scan_.labels->files)
      out.push_back({"input", file});
    if (scan_.ct != nullptr)
      for (const fs::path& file : scan_.ct->files)
        out.push_back({"hu", file});
    for (farm::NamedFile& file : files_of(parsed_->a))
      if (file.of == "mask") {
        for (fs::path& path : files_of_volume(file.path))
          out.push_back({file.of, std::move(path)});
      } else if (file.of != "hu") {
        out.push_back(std::move(file));
      }
    return out;
  }

  json warnings() const override { return warnings_; }

  Result<farm::ScanOutputs> mesh() override {
    auto result = mesh_scan(parsed_->a, scan_);
    if (!result) return result.error();
    farm::ScanOutputs out;
    out.asset = std::move(result->glb);
    out.report = stored_report(std::move(result->report), *scan_.labels);
    return out;
  }

 private:
  std::unique_ptr<Parsed> parsed_;
  LabelsWithCt scan_;
  json warnings_;
};

bool is_nifti_file(const fs::path& path) {
  std::error_code ignored;
  return is_nifti(path) && fs::is_regular_file(path, ignored);
}

// The number of cores that this process may use. TBB is not asked, because it would start threads,
// and then the scans' processes could not be forked.
int cores() {
  cpu_set_t set;
  return ::sched_getaffinity(0, sizeof set, &set) == 0 ? std::max(1, CPU_COUNT(&set)) : 1;
}

// The names in a file, one on each line.
Result<std::set<std::string>> names_in(const fs::path& file) {
  std::string text;
  if (file == "-") {
    text.assign(std::istreambuf_iterator<char>(std::cin), {});
  } else {
    const auto bytes = read_file(file);
    if (!bytes) return usage("--only " + bytes.error().message);
    text.assign(bytes->begin(), bytes->end());
  }
  std::set<std::string> out;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    while (!line.empty() && (line.back() == '\r' || line.back() == ' '))
      line.pop_back();
    if (!line.empty()) out.insert(line);
  }
  return out;
}

// A progress bar, which changes at most every 100 ms.
std::function<void(std::size_t, std::size_t, std::size_t)> scan_progress() {
  using Clock = std::chrono::steady_clock;
  return [shown = Clock::time_point()](std::size_t done, std::size_t failed,
                                       std::size_t total) mutable {
    const auto now = Clock::now();
    if (done < total && now - shown < std::chrono::milliseconds(100)) return;
    shown = now;
    constexpr std::size_t kWidth = 30;
    std::string bar(kWidth * done / total, '#');
    bar.resize(kWidth, '.');
    std::fprintf(stderr, "\r  [%s] %zu of %zu scans, %zu failed %s", bar.c_str(), done, total,
                 failed, done == total ? "\n" : "");
  };
}

json failures_json(const std::vector<farm::FailedScan>& failed) {
  json out = json::array();
  for (const auto& [scan, outcome] : failed) {
    out.push_back({{"scan", scan},
                   {"status", "failed"},
                   {"reason", outcome.reason},
                   {"exit_code", outcome.exit_code},
                   {"signal", outcome.signal == 0 ? json() : json(outcome.signal)}});
  }
  return out;
}

void print_failures(const std::vector<farm::FailedScan>& failed) {
  if (failed.empty()) return;
  std::size_t width = 4;
  for (const auto& [scan, outcome] : failed)
    width = std::max(width, scan.size());
  print(stderr, "%-*s  exit  reason\n", static_cast<int>(width), "scan");
  for (const auto& [scan, outcome] : failed) {
    print(stderr, "%-*s  %4d  %s\n", static_cast<int>(width), scan, outcome.exit_code,
          outcome.reason);
  }
}

json warnings_json(const std::vector<farm::WarnedScan>& warned) {
  json out = json::array();
  for (const auto& [scan, warnings] : warned)
    for (json one : warnings) {
      one["scan"] = scan;
      out.push_back(std::move(one));
    }
  return out;
}

// One line for each code, with the first scans that it concerns.
void print_warnings(const std::vector<farm::WarnedScan>& warned, std::FILE* to) {
  constexpr std::size_t kMaxNames = 5;
  std::map<std::string, std::set<std::string>> scans;
  for (const auto& [scan, warnings] : warned)
    for (const json& one : warnings)
      scans[one["code"]].insert(scan);
  for (const auto& [code, names] : scans) {
    std::string line;
    std::size_t k = 0;
    for (const std::string& name : names)
      if (k++ < kMaxNames) line += (line.empty() ? "" : ", ") + name;
    if (names.size() > kMaxNames)
      line += ", and " + std::to_string(names.size() - kMaxNames) + " more";
    print(to, "warning %s: %s\n", code, line);
  }
}

int dry_run(const BatchArguments& a, const farm::Batch& batch, json head) {
  using Kind = farm::ScanState::Kind;
  const auto states = batch.dry_run();
  if (!states) return fail(states.error());
  json stale = json::array(), known = json::array();
  std::uint64_t asset_bytes = 0;
  for (const auto& [scan, state] : *states) {
    asset_bytes += state.asset_bytes;
    if (state.kind == Kind::kStale) stale.push_back({{"scan", scan}, {"why", state.why}});
    if (state.kind == Kind::kKnownFailure)
      known.push_back({{"scan", scan},
                       {"reason", state.why[0]["reason"]},
                       {"exit_code", state.why[0]["exit_code"]}});
  }
  if (a.as_json) {
    head["scans"] = batch.scans();
    head["unchanged"] = batch.scans() - stale.size() - known.size();
    head["known"] = known.size();
    head["asset_bytes"] = asset_bytes;
    head["stale"] = std::move(stale);
    head["known_failures"] = std::move(known);
    print_lines(stdout, json_text(head, 1) + "\n");
    return 0;
  }
  for (const auto& [scan, state] : *states) {
    if (state.kind == Kind::kDone) continue;
    const bool is_known = state.kind == Kind::kKnownFailure;
    std::string why;
    for (const json& cause : state.why)
      why += (why.empty() ? "" : "; ") +
             (is_known ? cause["reason"].get<std::string>() : farm::cause_text(cause));
    print(stdout, "%s: %s%s\n", scan, is_known ? "known failure: " : "", why);
  }
  std::printf("%zu of %zu scans are stale", stale.size(), batch.scans());
  if (!known.empty()) std::printf(", %zu are known failures", known.size());
  std::printf("\n");
  return 0;
}

const char* name_of(farm::ScanState::Kind kind) {
  using Kind = farm::ScanState::Kind;
  return kind == Kind::kDone ? "unchanged" : kind == Kind::kStale ? "stale" : "known_failure";
}

int explain(const BatchArguments& a, const farm::Batch& batch, json head) {
  using Kind = farm::ScanState::Kind;
  const auto state = batch.explain(a.explain);
  if (!state) return fail(state.error());
  if (a.as_json) {
    head["scan"] = a.explain;
    head["status"] = name_of(state->kind);
    head["why"] = state->why;
    head["warnings"] = state->warnings;
    print_lines(stdout, json_text(head, 1) + "\n");
    return 0;
  }
  print(stdout, "%s: %s\n", a.explain,
        state->kind == Kind::kDone    ? "is done and unchanged"
        : state->kind == Kind::kStale ? "is stale"
                                      : "is a known failure and unchanged");
  for (const json& cause : state->why)
    print(stdout, "  %s\n", farm::cause_text(cause));
  for (const json& warning : state->warnings)
    print(stdout, "  warning %s: %s: %s\n", warning["code"].get<std::string>(),
          warning["where"].get<std::string>(), warning["sentence"].get<std::string>());
  return 0;
}

Result<json> clean(const BatchArguments& a, const fs::path& folder,
                   const farm::Collection& collection) {
  const auto store = farm::Store::open_for_writing(folder);
  if (!store) return store.error();
  std::set<std::string> wanted;
  for (const farm::CollectionScan& scan : collection.scans)
    wanted.insert(scan.name);
  const auto grace = std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double, std::ratio<60>>(a.grace_minutes));
  const auto done = farm::collect_garbage(*store, grace, a.prune ? &wanted : nullptr);
  if (!done) return done.error();
  if (!a.quiet && !a.as_json) {
    if (a.prune)
      print(stdout, "%zu scan%s that the collection does not name dropped\n", done->dropped,
            done->dropped == 1 ? "" : "s");
    std::printf("%zu files removed, %.1f MB; %zu kept", done->removed,
                static_cast<double>(done->bytes) / 1e6, done->kept);
    if (a.grace_minutes > 0)
      std::printf(", among them all younger than %g min (--grace)", a.grace_minutes);
    std::printf("\n");
  }
  return json{{"removed", done->removed},
              {"bytes", done->bytes},
              {"kept", done->kept},
              {"dropped", done->dropped}};
}

void print_summary(const BatchArguments& a, const farm::BatchSummary& s) {
  if (!s.has_journal)
    print(stderr, "trocar-mesh: warning: %s: the journal could not be written\n",
          (a.settings.store / "journal"));
  if (a.as_json) return;
  if (!a.quiet) {
    std::printf("%zu scans: %zu unchanged, %zu made, %zu found in the store, %zu failed", s.scans,
                s.unchanged, s.made, s.found, s.failed.size());
    if (!s.known.empty())
      print(stdout, ", %zu known failure%s%s", s.known.size(), s.known.size() == 1 ? "" : "s",
            a.strict ? "" : " (--dry-run lists them)");
    if (s.left > 0) std::printf(", %zu left", s.left);
    if (!s.warned.empty())
      std::printf("; %zu with warnings (--explain SCAN prints them)", s.warned.size());
    std::printf("; %.1f s\n", s.seconds);
    for (const std::string& name : s.made_again)
      print(stdout, "made again although it was done: %s\n", name);
    if (!a.strict) print_warnings(s.warned, stdout);
  }
}

int run(const BatchArguments& a, const farm::Collection& collection, const farm::Batch& batch,
        const fs::path& store, json head) {
  const auto summary = batch.run();
  if (!summary) return fail(summary.error());
  print_summary(a, *summary);
  print_failures(summary->failed);
  if (a.strict) {
    print_failures(summary->known);
    print_warnings(summary->warned, stderr);
  }
  head.update({{"scans", summary->scans},
               {"unchanged", summary->unchanged},
               {"made", summary->made},
               {"found", summary->found},
               {"failed", summary->failed.size()},
               {"known", summary->known.size()},
               {"left", summary->left},
               {"warned", summary->warned.size()},
               {"warnings", warnings_json(summary->warned)},
               {"asset_bytes", summary->asset_bytes},
               {"seconds", summary->seconds},
               {"made_again", summary->made_again},
               {"failures", failures_json(summary->failed)},
               {"known_failures", failures_json(summary->known)}});
  std::optional<Error> wrong;
  if (summary->has_unrecorded)
    wrong = unwritable(a.settings.store.string() +
                       ": some failures could not be recorded; when the store can be written, for "
                       "example after making room on a full disk, give the same command again");
  if (stop_requested.load()) {
    wrong = unwritable("interrupted; " + std::to_string(summary->left) +
                       " scans are left for the next run");
  } else if (a.gc) {
    auto cleaned = clean(a, store, collection);
    if (!cleaned)
      wrong = cleaned.error();
    else
      head["gc"] = std::move(*cleaned);
  }
  if (a.as_json) print_lines(stdout, json_text(head, 1) + "\n");
  if (wrong) return fail(*wrong);
  if (a.settings.max_failures > 0 && summary->failed.size() >= a.settings.max_failures &&
      summary->left > 0)
    return fail(refused("stopped after " + std::to_string(summary->failed.size()) +
                        " failures (--max-failures " + std::to_string(a.settings.max_failures) +
                        "); " + std::to_string(summary->left) +
                        " scans are left for the next run"));
  const bool has_failed = !summary->failed.empty() ||
                          (a.strict && (!summary->known.empty() || !summary->warned.empty()));
  const bool has_made_none = summary->scans > 0 && summary->known.size() == summary->scans;
  if (!has_failed && a.only.empty() && !a.settings.shard && has_made_none)
    return fail(
        refused("none of the scans could be made, now or in earlier runs; --dry-run lists "
                "the reasons"));
  return has_failed ? static_cast<int>(ExitCode::kRefused) : 0;
}

// Runs the batch and returns the exit code:
//  - 2: the options or the collection are wrong.
//  - 3: a scan failed in this run.
//  - 3, without --only and --shard: every scan of the collection failed in an earlier run and was
//    not tried again, and none of them has an asset.
//  - 3, only with --strict: a failure of an earlier run was not tried again.
//  - 4: the store could not be written, or a signal interrupted the run.
//  - 1: there was an internal error, for example if no process could be created.
//  - 0: none of these applies.
int run_batch(const BatchArguments& a) {
  std::error_code error;
  const fs::path store = fs::absolute(a.settings.store, error);
  farm::BatchSettings settings = a.settings;
  settings.store = store;
  if (settings.jobs == 0) settings.jobs = cores();
  settings.stop = &stop_requested;
  if (!a.quiet && ::isatty(STDERR_FILENO) != 0) settings.progress = scan_progress();
  if (!a.only.empty()) {
    if (const auto ok = names_in(a.only).into(settings.only); !ok) return fail(ok.error());
  }
  const auto collection = farm::read_collection(a.collection);
  if (!collection) return fail(collection.error());
  const auto digest = farm::sha256_of_file("/proc/self/exe");
  if (!digest) return fail(digest.error());
  // Paths in the collection are relative to its folder. So are paths in messages.
  fs::current_path(collection->folder, error);
  if (error) return fail(usage(collection->folder.string() + ": " + error.message()));
  stop_on_signals();
  const FarmScans scans(*digest);
  const auto batch = farm::Batch::plan(*collection, scans, std::move(settings));
  if (!batch) return fail(usage(a.collection.string() + ": " + batch.error().message));
  const json head = {
      {"schema", "trocar.batch/1"}, {"program", *digest}, {"store", a.settings.store.string()}};
  if (!a.explain.empty()) return explain(a, *batch, head);
  if (a.dry_run) return dry_run(a, *batch, head);
  return run(a, *collection, *batch, store, head);
}

}  // namespace

std::vector<std::string> collection_options() {
  return names_of(parameters_of(Parsed().app));
}

Result<farm::Parameters> FarmScans::parameters(const json& given) const {
  const auto parsed = parse_parameters(given);
  if (!parsed) return parsed.error();
  return farm::Parameters{canonical((*parsed)->a), files_of((*parsed)->a)};
}

Result<std::unique_ptr<farm::OpenedScan>> FarmScans::open(const json& given,
                                                          const std::vector<fs::path>& inputs,
                                                          const std::string& series,
                                                          int threads) const {
  auto parsed = parse_parameters(given);
  if (!parsed) return parsed.error();
  Arguments& a = (*parsed)->a;
  a.inputs = inputs;
  a.open.series = series;
  a.stack.threads = threads;
  auto scan = open_scan(a);
  if (!scan) return scan.error();
  // The report of meshing omits the warnings of opening, because they can be about files that do not
  // belong to the scan.
  SliceStack& stack = *scan->labels;
  json warnings = json::array();
  for (const Warning& w : stack.warnings) {
    warnings.push_back({{"code", w.code}, {"where", w.where}, {"sentence", w.sentence}});
    if (!w.shared.empty()) warnings.back()["shared"] = w.shared;
  }
  stack.warnings.clear();
  if (auto ok = check_input(a, stack); !ok) return ok.error();
  return std::unique_ptr<farm::OpenedScan>(
      std::make_unique<Opened>(std::move(*parsed), std::move(*scan), std::move(warnings)));
}

bool FarmScans::opens_first(const std::vector<fs::path>& inputs,
                            const farm::Parameters& parameters) const {
  return !std::all_of(inputs.begin(), inputs.end(), is_nifti_file) ||
         std::any_of(parameters.files.begin(), parameters.files.end(),
                     [](const farm::NamedFile& file) {
                       return (file.of == "hu" || file.of == "mask") && !is_nifti_file(file.path);
                     });
}

Command add_batch(CLI::App& command) {
  const auto made = std::make_shared<BatchArguments>();
  BatchArguments& a = *made;
  farm::BatchSettings& settings = a.settings;
  command
      .add_option("COLLECTION", a.collection,
                  "the collection, a .json file with scans and their parameters; list --manifest\n"
                  "prints one to begin with")
      ->required();
  command
      .add_option("-o,--output", settings.store,
                  "the store, a folder for all results; created if needed")
      ->type_name("STORE")
      ->required();
  settings.jobs = 0;
  add_number(command, "--jobs", settings.jobs, {0, 1024},
             "number of scans meshed at the same time, each in its own process; 0: "
             "one for each core");
  const auto shard = [&settings](const std::string& text) {
    const auto n = numbers<int>(text, "#/#");
    if (!n || (*n)[0] < 0 || (*n)[0] >= (*n)[1]) return "must be I/N with I from 0 to N-1";
    settings.shard = std::pair{(*n)[0], (*n)[1]};
    return "";
  };
  add_parsed(command, "--shard", shard,
             "work only on every Nth scan, beginning with scan I, so that N machines can share\n"
             "the work; the first scan is number 0",
             "I/N");
  command
      .add_option("--only", a.only,
                  "work only on the scans named in FILE, one per line; -: standard input")
      ->type_name("FILE");
  CLI::Option* const dry_run = command.add_flag(
      "--dry-run", a.dry_run,
      "print which scans are stale (this run would work on them), and why; write nothing");
  CLI::Option* const explain =
      command
          .add_option("--explain", a.explain,
                      "print whether this scan of the collection is stale, and why; write nothing")
          ->type_name("SCAN")
          ->excludes(dry_run);
  command.add_flag("--retry", settings.retry,
                   "also try scans again that were refused in an earlier run and have not changed\n"
                   "since");
  command.add_flag(
      "--rehash", settings.rehash,
      "read all inputs again, even if their size, time of change and inode (the number "
      "of\na file) are unchanged");
  CLI::Option* const gc = command.add_flag(
      "--gc", a.gc, "after the run, remove files from the store that belong to none of its scans");
  command
      .add_flag(
          "--prune", a.prune,
          "with --gc: first drop those scans from the store that the collection does not name")
      ->needs(gc);
  add_number(command, "--grace", a.grace_minutes, {0, 1e6},
             "with --gc: keep files younger than this many minutes")
      ->needs(gc);
  CLI::Option* const of_runs[] = {
      gc,
      add_number(command, "--max-failures", settings.max_failures, {0, 1'000'000},
                 "start no further scan after this many failures in this run; 0: no "
                 "limit"),
      command.add_flag("--strict", a.strict,
                       "end with exit code 3 also if scans have warnings, or failed in an earlier "
                       "run and were\nnot tried again in this run"),
      command.add_flag("--verify", settings.verify,
                       "verify every asset in the store, and make damaged ones again")};
  for (CLI::Option* option : of_runs)
    option->excludes(dry_run)->excludes(explain);
  command.add_flag("--json", a.as_json, "print the summary as JSON");
  command.add_flag("--quiet", a.quiet, "print errors only");
  return [made] { return run_batch(*made); };
}

}  // namespace trocar::pipeline
