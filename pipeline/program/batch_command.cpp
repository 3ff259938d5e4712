// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/batch_command.h"

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
#include <utility>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/base/program.h"
#include "formats/base/terminal_text.h"
#include "pipeline/farm/batch_run.h"
#include "pipeline/farm/collection.h"
#include "pipeline/farm/garbage.h"
#include "pipeline/farm/sha256.h"
#include "pipeline/farm/staleness.h"
#include "pipeline/program/farm_scans.h"
#include "pipeline/program/messages.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// The number of cores that this process may use. TBB is not asked, because it would start threads,
// and then the scans' processes could not be forked.
int cores() {
  cpu_set_t set;
  return ::sched_getaffinity(0, sizeof set, &set) == 0 ? std::max(1, CPU_COUNT(&set)) : 1;
}

Result<std::pair<int, int>> shard_of(const std::string& text) {
  int i = 0, n = 0, used = 0;
  if (std::sscanf(text.c_str(), "%6d/%6d%n", &i, &n, &used) != 2 ||
      used != static_cast<int>(text.size()) || i < 0 || i >= n)
    return usage("--shard " + text + ": must be I/N with I from 0 to N-1");
  return std::pair{i, n};
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

std::string time_left(double seconds) {
  char text[40];
  if (seconds < 100) {
    std::snprintf(text, sizeof text, "%.0f s", seconds);
  } else if (seconds < 6000) {
    std::snprintf(text, sizeof text, "%.0f min", seconds / 60);
  } else {
    std::snprintf(text, sizeof text, "%.1f h", seconds / 3600);
  }
  return text;
}

// A progress bar with the rate and the remaining time.
std::function<void(std::size_t, std::size_t, std::size_t)> scan_progress() {
  using Clock = std::chrono::steady_clock;
  return [start = Clock::now(), shown = Clock::time_point()](std::size_t done, std::size_t failed,
                                                             std::size_t total) mutable {
    const auto now = Clock::now();
    if (done < total && now - shown < std::chrono::milliseconds(100)) return;
    shown = now;
    constexpr std::size_t kWidth = 30;
    const double spent = std::chrono::duration<double>(now - start).count();
    const double rate = static_cast<double>(done) / std::max(spent, 1e-9);
    std::string bar(kWidth * done / total, '#');
    bar.resize(kWidth, '.');
    std::fprintf(stderr, "\r  [%s] %zu of %zu scans, %zu failed, %.3g a second, %s left   %s",
                 bar.c_str(), done, total, failed, rate,
                 time_left(static_cast<double>(total - done) / rate).c_str(),
                 done == total ? "\n" : "");
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

const char* name_of(farm::ScanState::Kind kind) {
  using Kind = farm::ScanState::Kind;
  return kind == Kind::kDone ? "unchanged" : kind == Kind::kStale ? "stale" : "known_failure";
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
          (a.store / "journal"));
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
    wrong = unwritable(a.store.string() +
                       ": some failures could not be recorded; when the store can be written, for "
                       "example after making room on a full disk, give the same command again");
  if (stop_requested.load()) {
    wrong = unwritable("interrupted; " + std::to_string(summary->left) +
                       " scans are left for the next run");
  } else if (a.gc) {
    auto cleaned = clean(a, store, collection);
    if (!cleaned) {
      wrong = cleaned.error();
    } else {
      head["gc"] = std::move(*cleaned);
    }
  }
  if (a.as_json) print_lines(stdout, json_text(head, 1) + "\n");
  if (wrong) return fail(*wrong);
  if (a.max_failures > 0 && summary->failed.size() >= a.max_failures && summary->left > 0)
    return fail(refused("stopped after " + std::to_string(summary->failed.size()) +
                        " failures (--max-failures " + std::to_string(a.max_failures) + "); " +
                        std::to_string(summary->left) + " scans are left for the next run"));
  const bool has_failed = !summary->failed.empty() ||
                          (a.strict && (!summary->known.empty() || !summary->warned.empty()));
  const bool has_made_none = summary->scans > 0 && summary->known.size() == summary->scans;
  if (!has_failed && a.only.empty() && a.shard.empty() && has_made_none)
    return fail(
        refused("none of the scans could be made, now or in earlier runs; --dry-run lists "
                "the reasons"));
  return has_failed ? static_cast<int>(ExitCode::kRefused) : 0;
}

Result<farm::BatchSettings> settings_of(const BatchArguments& a, const fs::path& store) {
  farm::BatchSettings out;
  out.store = store;
  out.jobs = a.jobs > 0 ? a.jobs : cores();
  out.rehash = a.rehash;
  out.verify = a.verify;
  out.retry = a.retry;
  out.max_failures = a.max_failures;
  out.stop = &stop_requested;
  if (!a.quiet && ::isatty(STDERR_FILENO) != 0) out.progress = scan_progress();
  if (!a.shard.empty()) {
    const auto shard = shard_of(a.shard);
    if (!shard) return shard.error();
    out.shard = *shard;
  }
  if (!a.only.empty()) {
    auto names = names_in(a.only);
    if (!names) return names.error();
    out.only = std::move(*names);
  }
  return out;
}

Result<void> check(const BatchArguments& a) {
  if (a.dry_run && !a.explain.empty()) return usage("--dry-run and --explain exclude each other");
  if (a.gc && (a.dry_run || !a.explain.empty()))
    return usage("--gc changes the store; --dry-run and --explain do not");
  if (a.verify && (a.dry_run || !a.explain.empty()))
    return usage("--verify makes damaged assets again; --dry-run and --explain make none");
  return {};
}

}  // namespace

void add_batch_options(const Command& command, BatchArguments& a) {
  command
      .option("COLLECTION", a.collection,
              "the collection, a .json file with scans and their parameters; list --manifest\n"
              "prints one to begin with")
      .required();
  command.option("-o,--output", a.store, "the store, a folder for all results; created if needed")
      .with_form("STORE")
      .required();
  command
      .option(
          "--jobs", a.jobs,
          "number of scans meshed at the same time, each in its own process; 0: one for each core")
      .with_default_shown()
      .within(0, 1024);
  command
      .option("--shard", a.shard,
              "work only on every Nth scan, beginning with scan I, so that N machines can share\n"
              "the work; the first scan is number 0")
      .with_form("I/N");
  command
      .option("--only", a.only,
              "work only on the scans named in FILE, one per line; -: standard input")
      .with_form("FILE");
  const Option dry_run = command.flag(
      "--dry-run", a.dry_run,
      "print which scans are stale (this run would work on them), and why; write nothing");
  const Option explain =
      command
          .option("--explain", a.explain,
                  "print whether this scan of the collection is stale, and why; write nothing")
          .with_form("SCAN");
  command.flag("--retry", a.retry,
               "also try scans again that were refused in an earlier run and have not changed\n"
               "since");
  command
      .option("--max-failures", a.max_failures,
              "start no further scan after this many failures in this run; 0: no limit")
      .with_default_shown()
      .within(0, 1'000'000)
      .excludes(dry_run)
      .excludes(explain);
  command
      .flag(
          "--strict", a.strict,
          "end with exit code 3 also if scans have warnings, or failed in an earlier run and were\n"
          "not tried again in this run")
      .excludes(dry_run)
      .excludes(explain);
  command.flag(
      "--rehash", a.rehash,
      "read all inputs again, even if their size, time of change and inode (the number of\n"
      "a file) are unchanged");
  command.flag("--verify", a.verify,
               "verify every asset in the store, and make damaged ones again");
  const Option gc = command.flag(
      "--gc", a.gc, "after the run, remove files from the store that belong to none of its scans");
  command
      .flag("--prune", a.prune,
            "with --gc: first drop those scans from the store that the collection does not name")
      .needs(gc);
  command.option("--grace", a.grace_minutes, "with --gc: keep files younger than this many minutes")
      .with_default_shown()
      .within(0.0, 1e6)
      .needs(gc);
  command.flag("--json", a.as_json, "print the summary as JSON");
  command.flag("--quiet", a.quiet, "print errors only");
}

int run_batch(const BatchArguments& a) {
  if (auto ok = check(a); !ok) return fail(ok.error());
  std::error_code error;
  const fs::path store = fs::absolute(a.store, error);
  const auto settings = settings_of(a, store);
  if (!settings) return fail(settings.error());
  const auto collection = farm::read_collection(a.collection);
  if (!collection) return fail(collection.error());
  const auto digest = farm::sha256_of_file("/proc/self/exe");
  if (!digest) return fail(digest.error());
  // Paths in the collection are relative to its folder. So are paths in messages.
  fs::current_path(collection->folder, error);
  if (error) return fail(usage(collection->folder.string() + ": " + error.message()));
  stop_on_signals();
  const FarmScans scans(*digest);
  const auto batch = farm::Batch::plan(*collection, scans, *settings);
  if (!batch) return fail(usage(a.collection.string() + ": " + batch.error().message));
  const json head = {
      {"schema", "trocar.batch/1"}, {"program", *digest}, {"store", a.store.string()}};
  if (!a.explain.empty()) return explain(a, *batch, head);
  if (a.dry_run) return dry_run(a, *batch, head);
  return run(a, *collection, *batch, store, head);
}

}  // namespace trocar::pipeline
